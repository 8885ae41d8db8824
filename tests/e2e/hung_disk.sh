#!/bin/bash
# hung_disk.sh LIBRARY: a running recording whose disk takes 2 s for each write: one exchange is late at most, and what is
# on the tape plus what its gaps tell is what passed. With a queue that is full, and at an end that the disk holds up, too.
# Environment: SECONDS_LONG (8), the time that exchanges go on. LIBRARY is tests/support/slow_disk.cpp.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
library=$1
[[ -e $library ]] || die "no $library"
long=${SECONDS_LONG:-8}

line_pair line
start "$devices/exchanges.py" device "$work/line.far" >"$work/device.out"
until_true 20 grep -q ready "$work/device.out" || die "the device does not come"
mkdir "$work/tapes"
SLOW_DISK_SWITCH=$work/hangs SLOW_DISK_FILES=$work/tapes/ LD_PRELOAD=$library \
  start "$PORTTAPED" record --device "serial:$work/line.near" --driver "pty:$work/port" --tape "$work/tapes/t" 2>"$work/log"
daemon=$started
wait_for "$work/port" "$work/log"
start "$devices/exchanges.py" driver "$work/port" --seconds "$long" >"$work/out"
driver=$started
until_true 20 test -s "$work/tapes/t.logw" || die "no traffic: $(cat "$work/log")"
touch "$work/hangs"
ended "$driver" $((long + 30)) || die "the driver does not get on: $(cat "$work/log")"
status_of "$driver"
[[ $status == 0 ]] || die "the driver gave $status: $(cat "$work/log")"
late=$(json "$work/out" over_1_s)
[[ $late -le 1 ]] || die "$late exchanges waited for the disk: $(cat "$work/out" "$work/log")"
grep -q 'over a queue from now on' "$work/log" || die "nothing is told of the slow disk: $(cat "$work/log")"
say "the disk hung: $(cat "$work/out")"

begin=$SECONDS
kill -TERM "$daemon"
ended "$daemon" 20 || die "SIGTERM does not end it: $(cat "$work/log")"
status_of "$daemon"
took=$((SECONDS - begin))
[[ $took -le 14 ]] || die "the end took $took s"
passed=$(json "$work/out" bytes)
"$PORTTAPE" info --json "$work/tapes/t" >"$work/info" || die "info: $(cat "$work/info")"
taped=$(($(json "$work/info" read.bytes) + $(json "$work/info" write.bytes)))
missing=$(json "$work/info" events.gap_bytes)
[[ $((taped + missing)) == $((2 * passed)) ]] ||
  die "$passed bytes passed each way, the tape has $taped and tells of $missing missing: $(cat "$work/log")"
[[ $status == 0 || $missing -gt 0 ]] || die "status $status with a whole tape: $(cat "$work/log")"
say "ended after $took s with status $status: $taped bytes on the tape, $missing told missing, $((2 * passed)) passed"
