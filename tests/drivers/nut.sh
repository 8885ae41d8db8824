#!/bin/bash
# nut.sh PORT DRIVER UPDATES: one of NUT's drivers, until it has read the UPS so many times; what it found must be right.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
driver=$1 updates=$2
case $driver in
  apcsmart) expected=("ups.status: OL" "battery.charge: 100.0" "battery.voltage: 27.40" "input.voltage: 231.1") ;;
  *) expected=("ups.status: OL" "battery.voltage: 27.40" "input.voltage: 231.2" "ups.load: 18") ;;
esac
export NUT_CONFPATH=$work NUT_STATEPATH=$work NUT_ALTPIDPATH=$work NUT_QUIET_INIT_UPSNOTIFY=1
options=(-i 1 -x "port=$port")
[[ $driver != nutdrv_qx ]] || options+=(-x protocol=megatec)
[[ $driver == apcsmart ]] || options+=(-x default.battery.voltage.low=20.8 -x default.battery.voltage.high=26)
# NUT's drivers open the port with the rights of the user they run as.
timeout 120 "/lib/nut/$driver" -u "$(id -un)" -s ups "${options[@]}" -d "$updates" >"$work/found" 2>"$work/log" ||
  die "$driver gave $?: $(tail -n 5 "$work/log")"
for line in "${expected[@]}"; do
  grep -qxF "$line" "$work/found" || die "not found: $line; it says $(cat "$work/found")"
done
say "$driver: $updates updates"
