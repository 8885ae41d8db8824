#!/bin/bash
# control.sh: the control socket as its users meet it: status, a mark on the tape, the end of one channel and of all, several
# daemons, daemons that were killed or are stopped, clients that mean ill, and places where no socket can be made.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
cd "$work"
line_pair line
start socat "FILE:$work/line.far,raw,echo=0" PIPE
own() { "$PORTTAPE" "$@" >out 2>err; }
fails() { # STATUS WORDS ARGUMENT…
  try own "${@:3}"
  [[ $status == "$1" ]] || die "porttape ${*:3} gives $status: $(cat out err)"
  grep -qF -- "$2" err || die "porttape ${*:3} does not say '$2': $(cat err)"
}

fails 1 "no porttaped" status
fails 1 "no porttaped" ctl stop
start "$PORTTAPED" record --device "serial:$work/line.near" --driver "pty:$work/port" --tape first 2>log
record=$started
wait_for "$work/port" log
until_true test -S "control/$record.sock" || die "no control socket: $(cat log)"
[[ $(stat -c %a "control/$record.sock") == 600 ]] || die "the socket is not its owner's alone"
fails 1 "no driver has opened the port yet" ctl mark early
fails 2 "accepted: mark, pause, resume, step, seek, rate, stop" ctl frobnicate
fails 1 "is no porttaped" ctl -p 1 stop
own status || die "status: $(cat err)"
grep -q "waits for a driver" out || die "a line without a driver: $(cat out)"
exec 8<>"$work/port"
printf 'one\n' >&8
head -n 1 <&8 >/dev/null
own ctl mark arm is moving || die "mark: $(cat err)"
printf 'two\n' >&8
head -n 1 <&8 >/dev/null
own status || die "status: $(cat err)"
tr -d '\n' <out | grep -qE "opened by +[^ ]+ +\($$\)" || die "who has the port open is not told: $(cat out)"
awk 'length > 80 && !/\// { exit 1 }' out || die "lines over 80 columns: $(cat out)"
own status --json || die "status --json: $(cat err)"
[[ $(json out channels) == *'"state": "open"'*'"from_driver_bytes": 8'*'"name": "first.log"'* ]] || die "$(cat out)"
exec 8>&-
own ctl stop || die "stop: $(cat err)"
alive "$record" && die "it runs after ctl stop"
status_of "$record"
[[ $status == 0 ]] || die "exit $status: $(cat log)"
[[ ! -e control/$record.sock ]] || die "the socket outlives its daemon"
"$PORTTAPE" cat first | grep -E 'one|mark|two' | sed 's/.*\(one\|arm is moving\|two\).*/\1/' | tr '\n' ' ' >order
[[ $(cat order) == "one one arm is moving two two " ]] || die "the mark is not in its place: $("$PORTTAPE" cat first)"
"$PORTTAPE" verify first >/dev/null || die "the tape with a mark is not sound"
say "status, mark in its place, stop"

# Two daemons: which is meant must be said. One channel ends, the others go on.
cat >channels.conf <<END
[channel one]
device = unix:$work/none,wait
driver = pty:$work/one
[channel two]
device = unix:$work/none,wait
driver = pty:$work/two
END
start "$PORTTAPED" run channels.conf 2>log2
run=$started
start "$PORTTAPED" record --device "serial:$work/line.near" --driver "pty:$work/port" --tape second 2>log
record=$started
wait_for "$work/two" log2
wait_for "$work/port" log
until_true test -S "control/$record.sock"
until_true test -S "control/$run.sock"
fails 2 "2 daemons could be meant; say which with -p PID: " ctl stop
fails 1 "no porttaped runs with a channel 'three'" ctl -c three stop
own ctl -c one stop || die "stop of a channel: $(cat err)"
[[ ! -e one && -e two ]] || die "not the one channel has ended: $(ls)"
fails 1 "channel 'one' has ended" ctl -c one stop
own status || die "status: $(cat err)"
[[ $(grep -c ^porttaped out) == 2 ]] || die "not both daemons are told of: $(cat out)"
grep -q "has ended with status 0" out || die "the ended channel is not told of: $(cat out)"
own status -p "$run" || die "status -p: $(cat err)"
[[ $(grep -c ^porttaped out) == 1 ]] || die "-p: $(cat out)"

# One that is stopped does not answer, and is told of.
kill -STOP "$run"
own status || die "status: $(cat err)"
grep -q "process $run does not answer" err || die "a stopped daemon: $(cat err)"
kill -CONT "$run"
own ctl -p "$run" stop || die "stop by pid: $(cat err)"
status_of "$run"
say "two daemons, one channel, a stopped one"

# Clients that mean ill: the line works, memory stays.
rss() { awk '/VmHWM/ { print $2 }' "/proc/$1/status"; }
before=$(rss "$record")
"$PYTHON" - "control/$record.sock" "$work/port" "$devices" <<'END' || die "the line under a flood: $(cat log)"
import socket, sys, threading
sys.path.insert(0, sys.argv[3])
from line import Line
def connect():
    client = socket.socket(socket.AF_UNIX)
    client.connect(sys.argv[1])
    return client
over = threading.Event()
def persist(act):
    while not over.is_set():
        try: act()
        except OSError: pass
def flood():
    client = connect()
    client.settimeout(0.2)
    while not over.is_set(): client.send(b'{"verb":"status"}\n' * 1000)
def long_line():
    client = connect()
    client.settimeout(5)
    client.sendall(b"x" * 10_000_000)
def nonsense():
    client = connect()
    client.sendall(bytes(range(256)) * 10 + b"\n")
    client.recv(100)
silent = [connect() for _ in range(40)]
threads = [threading.Thread(target=persist, args=(act,)) for act in (flood, flood, flood, long_line, nonsense, connect)]
for thread in threads: thread.start()
line = Line(sys.argv[2])
for n in range(200):
    words = b"line %d\n" % n
    line.write(words)
    if line.read_until(b"\n", 60) != words: over.set(); sys.exit("no answer")
over.set()
END
after=$(rss "$record")
((after - before < 8192)) || die "memory went from $before to $after kB"
own ctl stop || die "stop after a flood: $(cat err)"
status_of "$record"
[[ $status == 0 ]] || die "exit $status: $(cat log)"
[[ $("$PORTTAPE" cat --json second | grep -c '"dir":"w"') -ge 200 ]] || die "not all is on the tape"
say "flood, long lines, nonsense, silence: the line works, $((after - before)) kB more"

# A killed daemon leaves its socket behind: whoever finds it removes it.
start "$PORTTAPED" bridge --device "serial:$work/line.near" --driver "pty:$work/port" 2>log
until_true test -S "control/$started.sock" || die "no control socket: $(cat log)"
kill -KILL "$started"
status_of "$started"
rm -f "$work/port" # it may lead to another's pty by now
[[ -S control/$started.sock ]] || die "who removed it?"
fails 1 "no porttaped" status
[[ ! -e control/$started.sock ]] || die "a stale socket stays"

# Where none can be made the line works all the same; told once.
for place in "$work/no/such/folder" "$work/log" "$work/$(printf 'x%.0s' {1..120})"; do
  RUNTIME_DIRECTORY=$place start "$PORTTAPED" bridge --device "serial:$work/line.near" --driver "pty:$work/port" 2>log
  wait_for "$work/port" log
  talk "$work/port" "without a control socket"
  [[ $(grep -c "warning.*control socket" log) == 1 ]] || die "not told once: $(cat log)"
  stop "$started"
done
mkdir -m 777 "$work/open"
mkdir -m 777 "$work/open/porttape"
if [[ $(id -u) != 0 ]]; then
  env -u RUNTIME_DIRECTORY XDG_RUNTIME_DIR="$work/open" timeout 120 "$PORTTAPED" bridge --device "serial:$work/line.near" \
    --driver "pty:$work/port" 2>log &
  wait_for "$work/port" log
  grep -q "others have access to the folder" log || die "a folder that all may use is used: $(cat log)"
  wait
fi
say "stale sockets, and places where none can be made"

# The bytes in the log, only when asked for.
for level in debug trace; do
  start "$PORTTAPED" bridge --device "serial:$work/line.near" --driver "pty:$work/port" --log-level $level 2>log
  wait_for "$work/port" log
  talk "$work/port" hello
  stop "$started"
  if [[ $level == trace ]]; then
    grep -qF -- '-> 6 bytes  "hello\n"  68656c6c6f0a' log || die "no bytes in the trace: $(cat log)"
    grep -q -- '<- .* bytes' log || die "no answer in the trace: $(cat log)"
  else
    ! grep -q -- '-> ' log || die "bytes at the level debug"
  fi
done
start "$PORTTAPED" replay --tape first --driver "pty:$work/port" --log-level trace 2>log
wait_for "$work/port" log
talk "$work/port" one
stop "$started"
grep -qF -- '<- 4 bytes  "one\n"' log || die "no bytes in the trace of a replay: $(cat log)"
say "--log-level trace shows the bytes"
