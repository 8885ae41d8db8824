#!/bin/bash
# driver: C-Kermit, which sends 64 KiB and gets 64 KiB;  device: another C-Kermit as a server.
# shellcheck source=scenario.sh
source "$(dirname "$0")/../scenario.sh"
need kermit
export TZ=UTC # the files' times travel in local time
size=65536
random_file() {
  "$PYTHON" -c 'import random, sys; sys.stdout.buffer.write(random.Random(int(sys.argv[1])).randbytes(int(sys.argv[2])))' "$1" "$size" >"$2"
  touch -d @1500000000 "$2"
}
# commands TTY: what both sides set. Whatever adapts to the clock is off, so that each run gives the same bytes.
commands() {
  printf '%s\n' "set carrier-watch off" "set line $1" "if fail exit 1 cannot open $1" "set speed 115200" \
    "set flow-control none" "set file type binary" "set transfer display none" \
    "set transfer slow-start off" "set streaming off" "set window 1" "set receive packet-length 1000"
}
mkdir "$work/far" "$work/near"
random_file 1 "$work/near/up.bin"
random_file 2 "$work/far/down.bin"
{ commands "$device"; echo server; } >"$work/far/commands"
{
  commands "$driver"
  printf '%s\n' "send up.bin" "if fail exit 2 send failed" "get /command down.bin {cat >down.bin}" "if fail exit 3 get failed" finish "exit 0"
} >"$work/near/commands"

cd "$work/far"
device kermit commands -Y >"$work/far.out" 2>&1
cd "$work/near"
timeout 200 kermit commands -Y </dev/null >"$work/near.out" 2>&1 || die "kermit: $(tail -3 "$work/near.out")"
if has_device; then cmp "$work/near/up.bin" "$work/far/up.bin" || die "the upload differs"; fi
cmp "$work/far/down.bin" "$work/near/down.bin" || die "the download differs"
say "ok: $size bytes each way"
