#!/bin/bash
# ends.sh: every end has its bound, with a driver that does not read and with a log that nobody reads.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
cd "$work"

"$PYTHON" - <<'END'
import struct
def block(at, data): return struct.pack(">III", at // 1000000, at % 1000000, len(data)) + data
open("much.logr", "wb").write(b"".join(block(1000 + n, b"x" * 1000) for n in range(30)))
open("much.logw", "wb").write(b"")
END

# deaf LINK: a driver that opens its port and never reads.
deaf() { start "$PYTHON" -c 'import os, sys, time
fd = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
print("open", flush=True)
time.sleep(600)' "$1" >opened; until_true grep -q open opened || die "the driver does not come"; driver=$started; }
# within PID SECONDS WHAT
within() {
  local begin=${EPOCHREALTIME/./}
  ended "$1" || die "$3: it does not end: $(cat log)"
  took=$(((${EPOCHREALTIME/./} - begin) / 1000))
  ((took <= $2 * 1000)) || late "$3: ended after $took ms, $2 s are its bound: $(cat log)"
}

for end in "--at-end exit" "--once --at-end exit"; do
  # shellcheck disable=SC2086 # several options
  start "$PORTTAPED" replay --tape much --driver "pty:$work/port" --timing none --strictness 0 $end 2>log
  daemon=$started
  wait_for "$work/port" log
  deaf "$work/port"
  within "$daemon" 9 "$end"
  grep -q 'reached nobody' log || die "$end: what was given up is not told: $(cat log)"
  stop "$driver"
  say "$end, a driver that does not read: ended $took ms after it came"
done

start "$PORTTAPED" replay --tape much --driver "pty:$work/port" --timing none --strictness 0 2>log
daemon=$started
wait_for "$work/port" log
deaf "$work/port"
kill -TERM "$daemon"
within "$daemon" 9 SIGTERM
stop "$driver"
say "SIGTERM: ended after $took ms"

start "$PORTTAPED" replay --tape much --driver "pty:$work/port" --timing none --strictness 0 2>log
daemon=$started
wait_for "$work/port" log
deaf "$work/port"
kill -TERM "$daemon"
# Two signals at once are one: the first must have been taken, and wait no more (SIGTERM has bit 14).
has_taken_it() { ! grep -qiE '^ShdPnd:.*[4567cdef][0-9a-f]{3}$' "/proc/$daemon/status"; }
until_true has_taken_it || die "SIGTERM is not taken: $(cat log)"
kill -TERM "$daemon"
within "$daemon" 2 "a second SIGTERM"
stop "$driver"
say "a second SIGTERM: ended after $took ms"

# A tape that must not fail, on a device that sends without end.
start socat "UNIX-LISTEN:$work/device.socket,fork" 'SYSTEM:cat /dev/zero' 2>device.log
wait_listening "$work/device.socket"
start bash -c 'ulimit -f 64; exec "$@"' bash "$PORTTAPED" record --device "unix:$work/device.socket" \
  --driver "pty:$work/port" --tape limited --fail-closed 2>log
daemon=$started
wait_for "$work/port" log
# A driver that reads until the tape is at its limit, and then no more.
"$PYTHON" -c 'import os, sys
fd = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
left = 200000
try:
  while left > 0: left -= len(os.read(fd, 4096))
  import time; time.sleep(600)
except OSError: pass' "$work/port" &
reader=$!
until_true grep -q 'fail-closed' log || die "the limit is not met: $(cat log)"
within "$daemon" 2 --fail-closed
status_of "$daemon"
kill "$reader" 2>/dev/null || true
[[ $status == 1 ]] || die "--fail-closed: exit $status"
say "--fail-closed: ended $took ms after the failure"

# The log's pipe is full and nobody reads it: the line works, SIGTERM ends it.
line_pair line
start socat "FILE:$work/line.far,raw,echo=0" PIPE
mkfifo pipe
exec 9<>pipe
"$PYTHON" -c 'import fcntl, os
fcntl.fcntl(9, fcntl.F_SETPIPE_SZ, 4096)
os.set_blocking(9, False)
try:
    while True: os.write(9, b"x" * 64)
except BlockingIOError: pass
os.set_blocking(9, True)'
talk() {
  "$PYTHON" -c 'import sys
sys.path.insert(0, sys.argv[1])
from line import Line
line = Line(sys.argv[2])
line.write(b"hello\n")
sys.exit(line.read_until(b"\n", 60) != b"hello\n")' "$devices" "$work/port" || die "no answer: $1"
}
start "$PORTTAPED" record --device "serial:$work/line.near" --driver "pty:$work/port" --tape blocked --log-level trace 2>&9
daemon=$started
wait_for "$work/port"
for _ in 1 2 3; do talk "stderr is blocked"; done
kill -TERM "$daemon"
within "$daemon" 4 "SIGTERM with a blocked stderr"
status_of "$daemon"
[[ $status == 0 ]] || die "exit $status"
[[ $(payload blocked.logr) == $'hello\nhello\nhello' ]] || die "the tape has $(payload blocked.logr)"
exec 9>&-
say "stderr blocked: the line works, ended after $took ms"

mkfifo nobody
start "$PORTTAPED" record --device "serial:$work/line.near" --driver "pty:$work/port" --tape fifo --log-file nobody
daemon=$started
wait_for "$work/port"
talk "a log file that nobody reads"
stop "$daemon"
say "--log-file a pipe without a reader: the line works"

# In the background without --log-file: where the log goes is told.
XDG_STATE_HOME=$work/state "$PORTTAPED" record -b --pidfile pid --device "serial:$work/line.near" \
  --driver "pty:$work/port" --tape back 2>told
daemon=$(cat pid)
place=$(sed -n 's/.*the log goes to //p' told)
[[ -n $place ]] || die "-b does not tell where its log goes: $(cat told)"
talk background
if [[ $place == /* ]]; then
  [[ $place == "$work/state/porttape/$daemon.log" ]] || die "the log goes to $place"
  mv "$place" "$place.1"
  kill -HUP "$daemon"
  until_true test -e "$place" || die "SIGHUP does not open the log file again"
  talk reopened
  until_true grep -q 'has closed it' "$place" || die "nothing in the new log file"
fi
kill -TERM "$daemon"
ended "$daemon" || { kill -KILL "$daemon"; die "SIGTERM does not end the background"; }
say "-b: the log goes to $place"

# SIGHUP: without a terminal it opens the log again, with one it ends, under nohup nothing.
setsid "$PORTTAPED" record --device "serial:$work/line.near" --driver "pty:$work/port" --tape hup1 >out 2>log &
daemon=$!
pids+=("$daemon")
wait_for "$work/port" log
kill -HUP "$daemon"
talk "after SIGHUP"
alive "$daemon" || die "SIGHUP without a terminal ends it"
kill -USR2 "$daemon"
talk "after SIGUSR2"
kill -TERM "$daemon"
status_of "$daemon"
start "$PYTHON" -c 'import os, pty, sys, time
pid, master = pty.fork()
if pid == 0: os.execvp(sys.argv[1], sys.argv[1:])
while not os.path.exists("port"): time.sleep(0.02)
os.close(master)  # the terminal goes
_, status = os.waitpid(pid, 0)
print(os.waitstatus_to_exitcode(status))' "$PORTTAPED" record --device "serial:$work/line.near" \
  --driver "pty:$work/port" --tape hup2 >code
ended "$started" || die "it outlives its terminal"
[[ $(tail -1 code) == 0 ]] || die "its terminal gone it ends with $(cat code)"
[[ ! -e $work/port ]] || die "its terminal gone it leaves the link behind"
say "SIGHUP: goes on without a terminal, ends with it"
start "$PYTHON" -c 'import os, pty, signal, sys, time
pid, master = pty.fork()
if pid == 0:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    os.execvp(sys.argv[1], sys.argv[1:])
while not os.path.exists("pid3") or not os.path.exists("port"): time.sleep(0.02)
os.close(master)
print("gone", flush=True)
_, status = os.waitpid(pid, 0)
print(os.waitstatus_to_exitcode(status))' "$PORTTAPED" record --device "serial:$work/line.near" \
  --driver "pty:$work/port" --tape hup3 --pidfile pid3 >code
until_true grep -q gone code || die "under nohup it does not start"
kill -HUP "$(cat pid3)"
for time in first second; do talk "$time under nohup"; done
kill -TERM "$(cat pid3)"
ended "$started" || die "under nohup SIGTERM does not end it"
[[ $(tail -1 code) == 0 ]] || die "under nohup it ends with $(cat code)"
say "SIGHUP: under nohup nothing"
