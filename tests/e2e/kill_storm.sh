#!/bin/bash
# kill_storm.sh: SIGKILLs `porttaped record` at random moments of a busy line, KILLS times (20). Each tape must be sound, and
# what either end had received before the kill must be on it, but for at most the last block.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
kills=${KILLS:-20}
RANDOM=${SEED:-$$}
block=4095 # the most that one read of a pty gives

# missing RECEIVED BLOCKFILE: how many received bytes are not on the tape; fails when the tape holds others.
missing() {
  "$PYTHON" -c 'import sys
sys.path.insert(0, sys.argv[1])
import tapefile
received, taped = open(sys.argv[2], "rb").read(), tapefile.payload(sys.argv[3])
common = min(len(received), len(taped))
if received[:common] != taped[:common]: sys.exit("the tape holds other bytes than were received")
print(len(received) - common, len(taped))' "$devices" "$1" "$2"
}

worst=0 torn=0 bytes=0
for ((n = 1; n <= kills; n++)); do
  rm -f "$work"/tape.log? "$work"/*.got
  line_pair line
  pair=$started
  rm -f "$work/port" # left by the kill before; its tty may be another one by now
  start "$PORTTAPED" record --device "serial:$work/line.near" --driver "pty:$work/port" --tape "$work/tape.log" 2>"$work/log"
  daemon=$started
  wait_for "$work/port" "$work/log"
  start "$devices/storm.py" device "$work/line.far" "$work/device.got" --seed "$RANDOM"
  device=$started
  wait_for "$work/device.got"
  start "$devices/storm.py" driver "$work/port" "$work/driver.got" --seed "$RANDOM"
  driver=$started
  until_true test -s "$work/driver.got" || die "no traffic: $(cat "$work/log")"
  sleep "0.$(printf '%03d' $((RANDOM % 400)))"
  kill -KILL "$daemon"
  status_of "$daemon"
  stop "$driver" "$device" "$pair"

  try "$PORTTAPE" verify "$work/tape.log" >"$work/out" 2>&1
  [[ $status == 0 ]] || die "kill $n: verify gave $status: $(cat "$work/out")"
  if grep -qi torn "$work/out"; then torn=$((torn + 1)); fi
  "$PORTTAPE" cat "$work/tape.log" >/dev/null 2>"$work/out" || die "kill $n: cat failed: $(cat "$work/out")"
  for side in driver:r device:w; do
    counted=$(missing "$work/${side%:*}.got" "$work/tape.log${side#*:}") || die "kill $n, ${side%:*}"
    lost=${counted% *} taped=${counted#* }
    [[ $lost -le $block ]] || die "kill $n: $lost bytes that the ${side%:*} received are not on the tape"
    if [[ $lost -gt $worst ]]; then worst=$lost; fi
    bytes=$((bytes + taped))
  done
  pids=()
done
say "$kills kills, $bytes bytes on tapes: all sound, $torn with a torn tail; at most $worst received bytes missing"
