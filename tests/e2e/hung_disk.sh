#!/bin/bash
# hung_disk.sh LIBRARY: two channels record to a disk that takes 2 s for each write: one exchange is late at most, of both
# together, and what is on the tapes plus what their gaps tell is what passed. The disk holds up the end, too.
# Environment: SECONDS_LONG (8), the time that exchanges go on. LIBRARY is tests/support/slow_disk.cpp.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
library=$1
[[ -e $library ]] || die "no $library"
long=${SECONDS_LONG:-8}

mkdir "$work/tapes"
for name in first second; do
  line_pair "$name"
  start "$devices/exchanges.py" device "$work/$name.far" >"$work/$name.device"
  until_true grep -q ready "$work/$name.device" || die "the device does not come"
  printf '[channel %s]\ndevice=serial:%s\ndriver=pty:%s\ntape=%s\n' "$name" "$work/$name.near" "$work/$name.port" \
    "$work/tapes/$name" >>"$work/config"
done
SLOW_DISK_SWITCH=$work/hangs SLOW_DISK_FILES=$work/tapes/ LD_PRELOAD=$library start "$PORTTAPED" run "$work/config" 2>"$work/log"
daemon=$started
wait_for "$work/first.port" "$work/log"
wait_for "$work/second.port" "$work/log"

# both write to their tapes directly before the disk hangs
for name in first second; do
  "$devices/exchanges.py" driver "$work/$name.port" --seconds 0.5 >"$work/$name.before" || die "no traffic: $(cat "$work/log")"
done
touch "$work/hangs"
over=0
for name in first second; do
  start "$devices/exchanges.py" driver "$work/$name.port" --seconds "$long" >"$work/$name.out"
  patience=$((long + 60)) ended "$started" || die "the driver does not get on: $(cat "$work/log")"
  status_of "$started"
  [[ $status == 0 ]] || die "the driver gave $status: $(cat "$work/log")"
  over=$((over + $(json "$work/$name.out" over_1_s)))
  say "the disk hung: $(cat "$work/$name.out")"
done
[[ $over -le 1 ]] || late "$over exchanges took over 1 s, as if they waited for the disk: $(cat "$work/log")"
grep -q 'over a queue from now on' "$work/log" || die "nothing is told of the slow disk: $(cat "$work/log")"

begin=$SECONDS
kill -TERM "$daemon"
ended "$daemon" || die "SIGTERM does not end it: $(cat "$work/log")"
status_of "$daemon"
took=$((SECONDS - begin))
[[ $took -le 14 ]] || late "the end took $took s"
passed=0 taped=0 missing=0
for name in first second; do
  "$PORTTAPE" info --json "$work/tapes/$name" >"$work/info" || die "info: $(cat "$work/info")"
  passed=$((passed + $(json "$work/$name.before" bytes) + $(json "$work/$name.out" bytes)))
  taped=$((taped + $(json "$work/info" read.bytes) + $(json "$work/info" write.bytes)))
  missing=$((missing + $(json "$work/info" events.gap_bytes)))
done
[[ $((taped + missing)) == $((2 * passed)) ]] ||
  die "$passed bytes passed each way, the tapes have $taped and tell of $missing missing: $(cat "$work/log")"
[[ $status == 0 || $missing -gt 0 ]] || die "status $status with whole tapes: $(cat "$work/log")"
say "ended after $took s with status $status: $taped bytes on the tapes, $missing told missing, $((2 * passed)) passed"
