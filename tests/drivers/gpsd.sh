#!/bin/bash
# gpsd.sh PORT FIXES [RATE] [OPTION…]: gpsd with these options, until its client has seen so many fixes, all at the right
# place. With a RATE, gpsd is then told to have the receiver speak at it, and as many fixes must follow.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
fixes=$1
shift
rate=
if [[ ${1:-} =~ ^[0-9]+$ ]]; then
  rate=$1
  shift
fi
free_ports tcp
# shellcheck disable=SC2154 # free_ports sets it
start gpsd -N -n -D 5 -S "$tcp" "$@" "$port" 2>"$work/gpsd.log"
gpsd=$started
wait_listening "$tcp" "$work/gpsd.log"
start gpspipe -w "127.0.0.1:$tcp" >"$work/seen" 2>&1
client=$started
has_seen() { [[ $(grep -c '"class":"TPV".*"lat":' "$work/seen") -ge $1 ]]; }
wait_for_more_fixes() {
  enough=$((enough + fixes))
  until_true has_seen "$enough" || die "no $enough fixes: $(tail -n 3 "$work/seen") $(tail -n 5 "$work/gpsd.log")"
}
enough=0
wait_for_more_fixes
if [[ -n $rate ]]; then
  exec {gpsd_socket}<>"/dev/tcp/127.0.0.1/$tcp"
  printf '?DEVICE={"path":"%s","bps":%d}\n' "$port" "$rate" >&"$gpsd_socket"
  wait_for_more_fixes
  grep -q "SER: speed $rate," "$work/gpsd.log" || die "gpsd took no other rate: $(grep SER: "$work/gpsd.log")"
fi
# A tape of this must have some to spare: what a flush costs the driver that reads it is not to be what it waits for.
patience=3 until_true has_seen $((enough + 10)) || true
stop "$client"
wrong=$(grep '"class":"TPV".*"lat":' "$work/seen" | grep -v '"lat":54.1801[0-9]*,"lon":7.8895' || true)
[[ -z $wrong ]] || die "another place: $wrong"
kill "$gpsd"
ended "$gpsd" || die "gpsd does not end"
say "all fixes"
