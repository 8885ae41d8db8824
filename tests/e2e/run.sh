#!/bin/bash
# run.sh MODE NAME [TAPE]: one scenario with real programs. Exit status: 0 right, 1 wrong, 77 a program is missing.
#   direct NAME         driver and device on a joined pair of ttys, no porttape
#                       (NAME_tcp: over TCP on the loopback interface; no second tap)
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
is_tcp() { [[ $name == *_tcp ]]; }
if is_tcp; then free_ports driver_port device_port; fi

# daemon VERB OPTION…: porttaped on both ends of the scenario; returns once it is ready.
daemon() {
  local device=serial:$work/line.near,baud=115200 driver=pty:$work/driver
  if is_tcp; then
    # shellcheck disable=SC2154 # free_ports sets them
    device=tcp:127.0.0.1:$device_port driver=tcp-listen:127.0.0.1:$driver_port
  fi
  if [[ $1 == record ]]; then set -- "$@" --device "$device"; fi
  start "$PORTTAPED" "$@" --driver "$driver" 2>"$daemon_log"
  if is_tcp; then wait_listening "$driver_port" "$daemon_log"; else wait_for "$work/driver" "$daemon_log"; fi
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
  ended "$1" 10 || die "porttaped does not end on SIGTERM"
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
    if is_tcp; then
      scenario "$device_port" "$device_port"
    else
      line_pair line
      scenario "$work/line.near" "$work/line.far"
    fi
    ;;
  record)
    is_tcp || line_pair line
    daemon record --tape "$tape" --overwrite "${record_opts[@]}"
    if is_tcp; then scenario "$driver_port" "$device_port"; else scenario "$work/driver" "$work/line.far"; fi
    daemon_ends "$started"
    if [[ $result == 0 ]]; then
      [[ $status == 0 ]] || die "porttaped exit $status: $(tail -5 "$daemon_log")"
      is_tcp || "$e2e/compare_tap.sh" "$tape" "$work/line" "$name"
    fi
    ;;
  replay)
    daemon replay --tape "$tape" --report "$work/report.json" "${replay_opts[@]}"
    if is_tcp; then scenario "$driver_port" -; else scenario "$work/driver" -; fi
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
