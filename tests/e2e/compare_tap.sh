#!/bin/bash
# compare_tap.sh TAPE TAP NAME: the bytes of both files of a tape against TAP.r.tap and TAP.w.tap, seen by a second tap.
# A device that pushes (nmea) also sends while nobody has the port open: then the tape must be one unbroken part.
# A driver that flushes (zmodem) drops what was on the line: for each flush that is on the tape, a run of bytes may be missing.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
tape=${1%.log}.log tap=$2 name=$3
runs_missing=0
[[ $name == zmodem ]] && runs_missing=$(grep -c '"event":"flush"' "${tape}e" || true)

# is_line TAPE_BYTES TAP_BYTES RUNS: whether the first are the second but for so many runs.
is_line() { "$PYTHON" -c 'import sys
tape, tap = (open(name, "rb").read() for name in sys.argv[1:3])
runs = int(sys.argv[3])
at = seen = 0
while True:
    while at < len(tape) and seen < len(tap) and tape[at] == tap[seen]:
        at += 1
        seen += 1
    if at == len(tape) and seen == len(tap):
        sys.exit(0)
    runs -= 1
    seen = tap.find(tape[at:at + 12], seen) if at < len(tape) else len(tap)
    if runs < 0 or seen < 0:
        sys.exit(f"byte {at + 1} of {len(tape)} on the tape is not what came ({len(tap)} bytes)")
' "$@"; }

for direction in r w; do
  payload "$tape$direction" >"$work/bytes"
  if [[ $name == nmea && $direction == r ]]; then
    "$PYTHON" -c 'import sys
tape, tap = (open(name, "rb").read() for name in sys.argv[1:])
sys.exit(not tape or tape not in tap)' "$work/bytes" "$tap.r.tap" || die "$tape$direction is no unbroken part of the line's bytes"
  else
    is_line "$work/bytes" "$tap.$direction.tap" "$runs_missing" || die "$tape$direction differs from what the second tap saw"
  fi
done
