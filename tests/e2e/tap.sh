#!/bin/bash
# `porttape exec --tap`: a driver of few words (tests/support/tap_calls.c) with a device of its own, a pty that sends
# back what it gets. What it reads and writes is what it would without, and is on the tape.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat gcc pgrep
support=$e2e/../support
cd "$work"
for program in tap_calls line_extras; do
  gcc -Wall -Wextra -g -O1 -o "$program" "$support/$program.c" -pthread || die "gcc cannot build $program"
done
driver=$work/tap_calls

start socat "pty,raw,echo=0,link=$work/near" PIPE
wait_for "$work/near"

# tapped TAPE OPTIONS… -- COMMAND…
tapped() {
  try timeout -k 5 120 "$PORTTAPE" exec --tap --tape "$1" "${@:2}" >out 2>said
  [[ $status == 0 ]] || die "$1: exit $status: $(cat said)"
}

for check in reads copies reopen signals race; do
  timeout 120 "$driver" "$check" near >/dev/null 2>said || die "$check without porttape: $(cat said)"
  tapped "$check" -- "$driver" "$check" near
  "$PORTTAPE" verify "$check" >/dev/null || die "$check: $("$PORTTAPE" verify "$check")"
  say "$check: as without"
done

# What was changed while it was written is on the tape as the wire had it.
[[ $(wc -c <out) == 40000 ]] || die "race: $(wc -c <out) bytes came back"
"$PYTHON" -c '
import sys
sys.path.insert(0, sys.argv[1])
import tapefile
wire = open("out", "rb").read()
assert tapefile.payload("race.logw") == wire, "written"
assert tapefile.payload("race.logr") == wire, "read"' "$devices" || die "race: the tape is not what was on the wire"
say "5000 writes that another thread changes: 0 differ from the wire"

# Each close and open is there, and the device's name; a pty in its place plays the same.
[[ $("$PORTTAPE" cat reopen | grep -c -- '-  open$') == 20 ]] || die "not 20 opens: $("$PORTTAPE" cat reopen)"
grep -q "\"device\":\"serial:$(readlink -f near)\"" reopen.loge || die "another device: $(head -n 1 reopen.loge)"
tapped named --device near -- "$driver" reopen '{port}'
try timeout -k 5 120 "$PORTTAPE" test --exec --tape named --report report -- "$driver" reopen '{port}' >out 2>said
[[ $status == 0 ]] || die "played: exit $status: $(cat said)"
verdict_is pass report
say "opens, closes and the device are on the tape, which plays"

# The line to type next talks to the tape, whatever name the command has for its device.
tapped next -- "$driver" reopen near
grep -qF -- "test --tape next.log --exec -- $driver reopen {port}" said || die "the next line: $(cat said)"

# What is known not to be seen is missing on the tape, and not as if nothing had been said.
# shellcheck disable=SC2016
try timeout -k 5 120 "$PORTTAPE" exec --tap --tape moved -- bash -c 'exec 3<>near; echo question >&3; read -r answer <&3; [[ $answer == question ]]' >out 2>said
[[ $status == 1 ]] || die "moved: exit $status: $(cat said)"
grep -q 'moved its device to descriptor 3' said || die "moved: not told: $(cat said)"
grep -q 'something is missing at' said || die "moved: no gap is told: $(cat said)"
! grep -q 'nothing passed' said || die "moved: $(cat said)"
try "$PORTTAPE" verify moved >out
[[ $status == 0 ]] || die "moved: verify gives $status: $(cat out)"
grep -q 'no damage found' out || die "moved: $(cat out)"
say "what is not seen is a gap, and the status 1"

# The command's limit of open files is its own.
# shellcheck disable=SC2016
try "$PORTTAPE" exec --tap --tape none --device near -- sh -c 'ulimit -n >&2; sleep 0' 2>said
grep -qx "$(ulimit -n)" said || die "another limit of open files: $(cat said)"

try timeout -k 5 120 "$PORTTAPE" exec --tap --tape other --device /dev/null -- "$driver" reopen near >out 2>said
[[ $status == 0 && ! -e other.logr ]] || die "/dev/null: exit $status: $(cat said)"
grep -q 'never opened serial:/dev/null' said || die "a device that it never opened: $(cat said)"
try timeout -k 5 120 "$work/line_extras" without seccomp -- "$PORTTAPE" exec --tap --tape other -- "$driver" reopen near >said 2>&1
[[ $status != 0 ]] || die "without seccomp: exit 0"
grep -q 'record --device PORT' said || die "without seccomp: no pty is offered: $(cat said)"
say "another device, seccomp forbidden: told"

drivers_left() { pgrep -f "^[^ ]*$work/tap_calls"; }
no_driver_left() { ! drivers_left >left; }
start "$PORTTAPE" exec --tap --tape killed -- sh -c "$driver signals near; $driver signals near" 2>said
until_true test -s killed.logr || die "nothing on the tape: $(cat said)"
kill -KILL "$started"
status_of "$started"
until_true no_driver_left || die "killed: left running: $(cat left)"
say "killed: no driver is left"
