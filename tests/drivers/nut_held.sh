#!/bin/bash
# nut_held.sh PORT SECONDS: NUT's nutdrv_qx as it runs for ever, polling each second, with upsd and upsc; after so many
# seconds what upsc tells must still be right, and no poll may have failed.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
seconds=$1
export NUT_CONFPATH=$work NUT_STATEPATH=$work NUT_ALTPIDPATH=$work NUT_QUIET_INIT_UPSNOTIFY=1
free_ports tcp
cat >"$work/ups.conf" <<END_OF_CONFIGURATION
[ups]
  driver = nutdrv_qx
  port = $port
  protocol = megatec
  pollinterval = 1
  default.battery.voltage.low = 20.8
  default.battery.voltage.high = 26
END_OF_CONFIGURATION
# shellcheck disable=SC2154 # free_ports sets it
printf 'LISTEN 127.0.0.1 %s\nMAXAGE 5\n' "$tcp" >"$work/upsd.conf"
: >"$work/upsd.users"
chmod 640 "$work"/*.conf "$work/upsd.users"

start /lib/nut/nutdrv_qx -u "$(id -un)" -a ups -F -D >"$work/driver.log" 2>&1
driver=$started
until_true test -S "$work/nutdrv_qx-ups" || die "the driver does not start: $(tail -n 5 "$work/driver.log")"
upsd=/lib/nut/upsd
[[ -x $upsd ]] || upsd=upsd
start "$upsd" -u "$(id -un)" -F -D >"$work/upsd.log" 2>&1
wait_listening "$tcp" "$work/upsd.log"

is_right() {
  local line
  upsc "ups@127.0.0.1:$tcp" >"$work/found" 2>"$work/upsc.log" || return 1
  for line in "ups.status: OL" "battery.voltage: 27.40" "input.voltage: 231.2" "ups.load: 18"; do
    grep -qxF "$line" "$work/found" || return 1
  done
}
until_true is_right || die "not found; upsc says $(cat "$work/found" "$work/upsc.log")"
# Data that are older than MAXAGE are stale, and upsc says so.
for ((n = 0; n < seconds; n++)); do
  sleep 1
  is_right || die "no more after $n s: $(cat "$work/found" "$work/upsc.log"); $(tail -n 5 "$work/driver.log")"
  alive "$driver" || die "the driver ended: $(tail -n 5 "$work/driver.log")"
done
say "right for $seconds s"
