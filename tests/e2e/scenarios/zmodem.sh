#!/bin/bash
# driver: lrzsz's sz, then its rz;  device: rz and sz behind socat. $SIZE bytes each way (256 KiB).
# sz ends by flushing its own last two bytes ("OO") away; the far rz can miss them. So the files are what counts.
# shellcheck source=scenario.sh
source "$(dirname "$0")/../scenario.sh"
need sz rz socat
size=${SIZE:-262144}
random_file() {
  "$PYTHON" -c 'import random, sys; sys.stdout.buffer.write(random.Random(int(sys.argv[1])).randbytes(int(sys.argv[2])))' "$1" "$size" >"$2"
  touch -d @1500000000 "$2" # time and mode travel with the file
  chmod 644 "$2"
}
mkdir "$work/far" "$work/near"
random_file 7 "$work/up.bin"
random_file 8 "$work/down.bin"

# The driver opens the line first; what the device says before that would be lost.
send_up() { cd "$work/near" && exec timeout 120 sz -b -q ../up.bin <"$driver" >"$driver" 2>"$work/sz.err"; }
get_down() { cd "$work/near" && exec timeout 120 rz -b -y -q <"$driver" >"$driver" 2>"$work/rz.err"; }
opened_or_over() { ! alive "$1" || has_open "$1" "$driver"; }

start send_up
upload=$started
until_true opened_or_over "$upload" || die "sz does not open $driver"
cd "$work/far"
device socat -t 0.05 "FILE:$device,raw,echo=0" EXEC:"rz -b -y -q" 2>/dev/null
receiver=$started
status_of "$upload"
[[ $status == 0 ]] || die "sz gave $status: $(cat "$work/sz.err")"
if has_device; then
  until_true cmp -s "$work/up.bin" "$work/far/up.bin" || die "the upload differs"
  patience=1 ended "$receiver" || stop "$receiver"
fi

start get_down
download=$started
until_true opened_or_over "$download" || die "rz does not open $driver"
cd "$work"
device socat -t 0.05 "FILE:$device,raw,echo=0" EXEC:"sz -b -q down.bin" 2>/dev/null
status_of "$download"
[[ $status == 0 ]] || die "rz gave $status: $(cat "$work/rz.err")"
cmp "$work/down.bin" "$work/near/down.bin" || die "the download differs"
say "ok: $size bytes each way"
