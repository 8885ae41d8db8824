#!/bin/bash
# compare_tap.sh TAPE TAP NAME: the bytes of both files of a tape against TAP.r.tap and TAP.w.tap, seen by a second tap.
# A device that pushes (nmea) also sends while nobody has the port open: then the tape must be one unbroken part.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
tape=${1%.log}.log tap=$2 name=$3
rule=equal
[[ $name == nmea ]] && rule=part
for direction in r w; do
  payload "$tape$direction" >"$work/bytes"
  if [[ $rule == part && $direction == r ]]; then
    "$PYTHON" -c 'import sys
tape, tap = (open(name, "rb").read() for name in sys.argv[1:])
sys.exit(not tape or tape not in tap)' "$work/bytes" "$tap.r.tap" || die "$tape$direction is no unbroken part of the line's bytes"
  else
    cmp "$work/bytes" "$tap.$direction.tap" || die "$tape$direction differs from what the second tap saw"
  fi
done
