#!/bin/bash
# sessions.sh: two sessions in one recording are seen, played and judged as two; a replay daemon ends with its worst run's
# status; half-closes reach the other side, recorded and replayed.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
cd "$work"

line_pair line
# shellcheck disable=SC2016 # the shell of SYSTEM expands it
start socat "FILE:$work/line.far,raw,echo=0" 'SYSTEM:while read word; do echo "got $word"; done'
start "$PORTTAPED" record --device "serial:$work/line.near" --driver "pty:$work/port" --tape two 2>log
daemon=$started
wait_for port log
ask port one
until_true closes log 1 || die "the first close is not seen: $(cat log)"
ask port two three
until_true closes log 2 || die "the second close is not seen: $(cat log)"
stop "$daemon"

"$PORTTAPE" info two >info
grep -q 'sessions   2' info || die "info does not see two sessions: $(cat info)"
"$PORTTAPE" info --json two >info.json
[[ $("$PYTHON" -c 'import json
print([(s["read_bytes"], s["write_bytes"]) for s in json.load(open("info.json"))["sessions"]])') == '[(8, 4), (18, 10)]' ]] ||
  die "info tells $(cat info.json)"
"$PORTTAPE" verify two | grep -q ': sound: ' || die "verify: $("$PORTTAPE" verify two)"

# test_of STATUS OPTIONS -- SHELL
test_of() {
  local expected=$1 shell=${*: -1}
  set -- "${@:2:$#-2}"
  try "$PORTTAPE" test --tape two --timeout 30 --report report "$@" -- bash -c "$shell" >out 2>err
  [[ $status == "$expected" ]] || die "$* ($shell): status $status: $(cat out err)"
}
test_of 0 'ask {port} one && sleep 0.2 && ask {port} two three'
[[ $(json report sessions) == '{"made": 2, "of": 2}' ]] || die "the report: $(cat report)"
test_of 0 --session all 'ask {port} one && sleep 0.2 && ask {port} two three'
test_of 0 --session 1 'ask {port} one'
test_of 0 --session 2 'ask {port} two three'
[[ $(json report from_driver.of) == 10 ]] || die "the played part is not counted by itself: $(cat report)"
test_of 3 --session 2 'ask {port} one'
test_of 2 --session 3 'ask {port} one'
grep -q 'has 2 sessions' err || die "it is not told how many there are: $(cat err)"
test_of 5 'ask {port} one'
grep -q 'the tape has two sessions, the driver made one' out || die "not told: $(cat out)"
say "two sessions: played together and alone"

# replayed OPTIONS…: the daemon; ended STATUS ends it.
replayed() {
  start "$PORTTAPED" replay --tape two --session 1 --driver "pty:$work/port" --report report "$@" 2>log
  daemon=$started
  wait_for port log
}
ends_with() {
  kill -TERM "$daemon"
  status_of "$daemon"
  [[ $status == "$1" ]] || die "the daemon ends with $status instead of $1: $(cat log)"
}
replayed
(ask port wrong) 2>/dev/null || true
until_true closes log 1 || die "the first run's close is not seen: $(cat log)"
ask port one
until_true closes log 2 || die "the second run's close is not seen: $(cat log)"
stty -F port >/dev/null
until_true closes log 3 || die "the look's close is not seen: $(cat log)"
ends_with 3
verdict_is pass report
[[ $(json report runs.count) == 2 && $(json report runs.looks) == 1 && $(json report runs.worst) == data-mismatch ]] ||
  die "the report's runs: $(json report runs)"
[[ $(json report exit) == 3 ]] || die "the report's exit is $(json report exit)"
grep -q '2 runs, the worst: data-mismatch; 1 look' log || die "the log does not tell: $(cat log)"
replayed
ends_with 5
verdict_is incomplete report
grep -q 'nobody has opened the port' log || die "the log does not tell that nobody came: $(cat log)"
replayed --strictness 0
stty -F port >/dev/null
until_true closes log 1 || die "the look's close is not seen: $(cat log)"
ends_with 5
replayed --once
stty -F port >/dev/null
until_true closes log 1 || die "the look's close is not seen: $(cat log)"
ask port one
status_of "$daemon"
[[ $status == 0 ]] || die "--once ends with $status: $(cat log)"
say "a replay daemon ends with the status of its worst run, and 5 where nobody came"

# A driver that ends its sending and is answered after that.
free_ports device port
# shellcheck disable=SC2154 # free_ports sets them
start socat "TCP-LISTEN:$device,bind=127.0.0.1,reuseaddr,fork" 'SYSTEM:wc -c'
wait_listening "$device"
# shellcheck disable=SC2154
start "$PORTTAPED" record --device "tcp:127.0.0.1:$device" --driver "tcp-listen:127.0.0.1:$port" --tape asks 2>log
daemon=$started
wait_listening "$port" log
[[ $(printf hello | socat -t 20 - "TCP:127.0.0.1:$port") == 5 ]] || die "no answer behind the half-close: $(cat log)"
until_true closes log 1 || die "the close is not seen: $(cat log)"
stop "$daemon"
grep -q '"event":"half-close","by":"driver"' asks.loge || die "no half-close on the tape: $(cat asks.loge)"
# test_tcp STATUS TAPE SHELL
test_tcp() {
  try "$PORTTAPE" test --tape "$2" --driver tcp-listen:127.0.0.1:0 --timeout 30 -- bash -c "$3" >out 2>err
  [[ $status == "$1" ]] || die "$3: status $status: $(cat out err)"
}
# shellcheck disable=SC2016 # the commands under test expand it
{
  test_tcp 0 asks '[[ $(printf hello | socat -t 20 - TCP:{port}) == 5 ]]'
  test_tcp 5 asks 'p={port}; exec 3<>"/dev/tcp/${p%:*}/${p#*:}"; printf hello >&3; read -r n <&3; [[ $n == 5 ]]'
  grep -q 'the driver ends its sending (half-close)' out || die "the missing half-close is not told: $(cat out)"
  try "$PORTTAPE" test --tape asks --timeout 30 -- bash -c 'exec 3<>{port}; printf hello >&3; read -r n <&3; [[ $n == 5 ]]' >out
}
[[ $status == 0 ]] || die "on a pty, which has no half-close: $(cat out)"
say "a driver's half-close: recorded, replayed, missed"

# A device that ends its sending and reads on.
cat >greeter.py <<'END'
import socket, sys
with socket.create_server(("127.0.0.1", int(sys.argv[1]))) as server:
    connection, _ = server.accept()
    connection.sendall(b"hello")
    connection.shutdown(socket.SHUT_WR)
    got = b""
    while data := connection.recv(100): got += data
    print(got.decode(), flush=True)
END
cat >listener.py <<'END'
import socket, sys
host, port = sys.argv[1].rsplit(":", 1)
with socket.create_connection((host, int(port)), 20) as line:
    got = b""
    while data := line.recv(100): got += data
    line.sendall(b"bye, " + got)
END
free_ports device port
start "$PYTHON" greeter.py "$device" >heard
greeter=$started
wait_listening "$device"
start "$PORTTAPED" record --device "tcp:127.0.0.1:$device" --driver "tcp-listen:127.0.0.1:$port" --tape greets 2>log
daemon=$started
wait_listening "$port" log
"$PYTHON" listener.py "127.0.0.1:$port"
ended "$greeter" || die "the device still waits: $(cat log)"
[[ $(cat heard) == 'bye, hello' ]] || die "what the driver wrote after the device's half-close is lost: $(cat heard log)"
stop "$daemon"
grep -q '"event":"half-close","by":"device"' greets.loge || die "no half-close on the tape: $(cat greets.loge)"
test_tcp 0 greets "$PYTHON $work/listener.py {port}"
say "a device's half-close: recorded and replayed"
