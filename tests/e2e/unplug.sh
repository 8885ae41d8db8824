#!/bin/bash
# unplug.sh: the device goes away in the middle of a recording. The tape keeps what came, the daemon says so and ends well.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
line_pair line
pair=$started
start "$PORTTAPED" record --device "serial:$work/line.near" --driver "pty:$work/port" --tape "$work/tape.log" 2>"$work/log"
daemon=$started
wait_for "$work/port" "$work/log"
start "$devices/storm.py" device "$work/line.far" "$work/device.got"
wait_for "$work/device.got"
start "$devices/storm.py" driver "$work/port" "$work/driver.got"
driver=$started
until_true test -s "$work/driver.got" || die "no traffic: $(cat "$work/log")"
sleep 0.2
kill -TERM "$pair" # both ttys are gone
until_true grep -qiE 'lost|gone|hung|unplug' "$work/log" || die "the log does not tell that the device is lost: $(cat "$work/log")"
patience=1 ended "$daemon" || kill -TERM "$daemon"
ended "$daemon" || die "porttaped does not end"
status_of "$daemon"
[[ $status == 0 || $status == 6 ]] || die "exit $status: $(cat "$work/log")"
stop "$driver"
[[ ! -L $work/port ]] || die "the link is still there"
"$PORTTAPE" verify "$work/tape.log" >"$work/out" 2>&1 || die "verify: $(cat "$work/out")"
payload "$work/tape.logr" >"$work/taped"
size=$(stat -c %s "$work/driver.got")
cmp -n "$size" "$work/taped" "$work/driver.got" || die "the tape lacks bytes that the driver received"
grep -qE 'device-lost|is lost' "$work/tape.loge" || die "the tape's events do not tell of the loss"
say "$size bytes received before the unplug, all on the tape"
