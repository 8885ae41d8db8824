#!/bin/bash
# driver: meter_client, which has a bug;  device: the meter's revision B, which shows it. Right is: the driver fails as reported.
# shellcheck source=scenario.sh
source "$(dirname "$0")/../scenario.sh"
if has_device; then [[ -x $DEVICE_BIN/modbus_slave ]] || die "modbus_slave is not built; ./check installs libmodbus-dev"; fi
device "$DEVICE_BIN/modbus_slave" "$device" 19200 b
try "$devices/meter_client.py" "$driver" >"$work/out" 2>&1
[[ $status == 1 ]] || die "the driver gave $status instead of failing: $(cat "$work/out")"
grep -q '7 of 10 polls failed' "$work/out" || die "it failed otherwise: $(cat "$work/out")"
grep -q '^poll 3: 230' "$work/out" || die "wrong before poll 4: $(cat "$work/out")"
grep -q '^poll 4: bad frame 00 01 04' "$work/out" || die "poll 4 fails otherwise: $(cat "$work/out")"
say "ok: the bug shows from poll 4 on"
