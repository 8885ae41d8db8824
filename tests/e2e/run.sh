#!/bin/bash
# run.sh MODE NAME [TAPE]: one scenario with real programs. Exit status: 0 right, 1 wrong, 77 a program is missing.
#   direct NAME         driver and device on a joined pair of ttys, no porttape
#                       (NAME_tcp, NAME_udp: on the loopback interface; NAME_unix: a socket; no second tap)
#   record NAME TAPE    the same through `porttaped record`; the tape must hold what a second tap on the line saw
#   replay NAME TAPE    the driver against the tape, without the device
# Environment: PORTTAPED; RECORD_OPTS and REPLAY_OPTS (more options); KEEP=1 keeps the work folders.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
usage() { echo "usage: run.sh direct|record|replay NAME [TAPE]" >&2; exit 64; }
[[ $# -ge 2 ]] || usage
mode=$1 name=$2 tape=${3:-}
[[ $mode == direct || -n $tape ]] || usage
[[ -x $e2e/scenarios/$name.sh ]] || { echo "run.sh: no scenario $name" >&2; exit 64; }
read -ra record_opts <<<"${RECORD_OPTS:-}"
read -ra replay_opts <<<"${REPLAY_OPTS:-}"
daemon_log=$work/daemon.log

# The line: what the scenario's driver and device open, and the same ends as PORTs.
line=serial
if [[ $name =~ _(tcp|udp|unix)$ ]]; then line=${BASH_REMATCH[1]}; fi
# shellcheck disable=SC2154 # free_ports sets them
case $line in
  serial)
    driver=$work/driver device=$work/line.far
    device_spec=serial:$work/line.near,baud=115200 driver_spec=pty:$driver
    ;;
  tcp)
    free_ports driver device
    device_spec=tcp:127.0.0.1:$device driver_spec=tcp-listen:127.0.0.1:$driver
    ;;
  udp)
    free_ports driver device
    device_spec=udp:127.0.0.1:$device,recv_ip=127.0.0.1,recv_port=0 driver_spec=udp-listen:127.0.0.1:$driver
    ;;
  unix)
    driver=$work/driver.socket device=$work/device.socket
    device_spec=unix:$device driver_spec=unix-listen:$driver
    ;;
esac
wait_line() {
  case $line in
    tcp | udp) wait_listening "$driver" "$daemon_log" ;;
    *) wait_for "$driver" "$daemon_log" ;;
  esac
}

# daemon VERB OPTION…: porttaped on both ends of the scenario; returns once it is ready.
daemon() {
  if [[ $1 == record ]]; then set -- "$@" --device "$device_spec" --wait-device; fi # the scenario starts it
  start "$PORTTAPED" "$@" --driver "$driver_spec" 2>"$daemon_log"
  wait_line
}

scenario() {
  local begin=${EPOCHREALTIME/./} seconds
  try "$e2e/scenarios/$name.sh" "$@"
  result=$status
  seconds=$(((${EPOCHREALTIME/./} - begin) / 10000))
  took=$(printf '%d.%02d s' $((seconds / 100)) $((seconds % 100)))
  if [[ $result != 0 && $result != 77 && -f $daemon_log ]]; then tail -20 "$daemon_log" >&2; fi
}

daemon_ends() { # sets $status
  kill -TERM "$1"
  ended "$1" || die "porttaped does not end on SIGTERM"
  status_of "$1"
}

# lrzsz's sz flushes its own last two bytes, "OO". Whether the proxy read them before differs from run to run.
only_oo_differs() {
  [[ $name == zmodem ]] && "$PYTHON" -c 'import json, sys
report = json.load(open(sys.argv[1]))
sent, mismatch = report["from_driver"], report["mismatch"]
missing = mismatch is None and sent["of"] - sent["matched"] == 2
other = mismatch is not None and "4f4f" in (mismatch["got_hex"][:4], mismatch["expected_hex"][:4])
sys.exit(not missing and not other)' "$1"
}

case $mode in
  direct)
    if [[ $line == serial ]]; then
      line_pair line
      driver=$work/line.near
    else
      driver=$device
    fi
    scenario "$driver" "$device"
    ;;
  record)
    [[ $line != serial ]] || line_pair line
    daemon record --tape "$tape" --overwrite "${record_opts[@]}"
    scenario "$driver" "$device"
    daemon_ends "$started"
    if [[ $result == 0 ]]; then
      [[ $status == 0 ]] || die "porttaped exit $status: $(tail -5 "$daemon_log")"
      [[ $line != serial ]] || "$e2e/compare_tap.sh" "$tape" "$work/line" "$name"
    fi
    ;;
  replay)
    daemon replay --tape "$tape" --report "$work/report.json" "${replay_opts[@]}"
    scenario "$driver" -
    daemon_ends "$started"
    if [[ $result == 0 ]] && ! only_oo_differs "$work/report.json"; then
      verdict_is pass "$work/report.json"
      [[ $status == 0 ]] || die "porttaped exit $status: $(tail -5 "$daemon_log")"
    fi
    ;;
  *) usage ;;
esac
say "$mode $name: status $result, $took"
exit "$result"
