#!/bin/bash
# laser.sh: a driver library that knows flexiport only, and a client of the blocking ports, on tapes of laser scanners: in
# their own process, over the daemon's pty, and over TCP: the same output each time. Environment: RUNS (3), the runs of
# each with all cores busy.
# shellcheck source=../e2e/lib.sh
source "$(dirname "$0")/../e2e/lib.sh"
runs=${RUNS:-3}
samples=$e2e/../../sample-logs

# same NAME COMMAND…: $runs times the output of $work/expected.
same() {
  local name=$1 run
  shift
  for ((run = 1; run <= runs; run++)); do
    timeout 120 "$@" >"$work/got" 2>"$work/err" || die "$name, run $run: $(cat "$work/err")"
    cmp -s "$work/expected" "$work/got" || die "$name, run $run: $(diff "$work/expected" "$work/got")"
  done
  say "$name: $runs of $runs"
}

# on TAPE COMMANDS…
on() {
  local tape=$1 daemon port
  shift
  local in_process="type=logreader,file=$tape,timing=reactive,strictness=1,timeout=60"
  "$DEVICE_BIN/scip_laser" "$in_process" "$@" >"$work/expected" || die "the client of the blocking ports fails"
  [[ $(grep -c 'status' "$work/expected") -ge $# ]] || die "answers are missing: $(cat "$work/expected")"
  for client in mini_laser_example scip_laser; do
    same "$client in-process" "$DEVICE_BIN/$client" "$in_process" "$@"

    start "$PORTTAPED" replay --tape "$tape" --driver "pty:$work/port" 2>"$work/log"
    daemon=$started
    wait_for "$work/port" "$work/log"
    same "$client over a pty" "$DEVICE_BIN/$client" "type=serial,device=$work/port,timeout=60" "$@"
    stop "$daemon"

    free_ports port
    start "$PORTTAPED" replay --tape "$tape" --driver "tcp-listen:127.0.0.1:$port" 2>"$work/log"
    daemon=$started
    wait_listening "$port" "$work/log"
    same "$client over TCP" "$DEVICE_BIN/$client" "type=tcp,port=$port,timeout=60" "$@"
    stop "$daemon"
  done
}

# recorded TAPE COMMANDS…: the driver library records a session with the daemon's device in its own process; the tape holds
# the same bytes and replays both ways.
recorded() {
  local tape=$1 again=$work/again.log daemon
  shift
  start "$PORTTAPED" replay --tape "$tape" --driver "pty:$work/port" 2>"$work/log"
  daemon=$started
  wait_for "$work/port" "$work/log"
  "$DEVICE_BIN/mini_laser_example" "type=seriallog,device=$work/port,timeout=60,file=$again" "$@" >"$work/expected"
  stop "$daemon"
  for direction in r w; do
    cmp <(payload "$tape$direction") <(payload "$again$direction") || die "the tape made in-process differs: $direction"
  done
  on "$again" "$@"
}

keep_busy
recorded "$samples/scip.log" VV PP II BM GD0044072501 GD0044072501 MD0384043101003 QT
on "$samples/scip.log" VV PP II BM GD0044072501 GD0044072501 MD0384043101003 QT
real=$SHARED_DIR/recordings/urg_04lx.log
if [[ -e ${real}r ]]; then
  on "$real" VV VV PP II BM CR00 VV PP II GD0044072501
else
  say "skipped: there is no recording $real"
fi
