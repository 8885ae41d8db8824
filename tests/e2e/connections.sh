#!/bin/bash
# connections.sh: several drivers at once on a listening port. With one at a time the second is refused, told, and its bytes
# reach nobody; with --connections each every one has its own line, tape and replay.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
cd "$work"
free_ports device driver
: "${device:?}" "${driver:?}"

# client PORT COMMAND…: a program for the connections that the script makes: each line of stdin is CONNECT NAME, SEND NAME
# TEXT, EXPECT NAME TEXT, OVER NAME (expects the end or a reset), CLOSE NAME. A driver's port is a number or a socket's path.
cat >client.py <<'END'
import socket, sys
where, lines = sys.argv[1], {}
def connect():
    if where.isdigit(): return socket.create_connection(("127.0.0.1", int(where)), 20)
    line = socket.socket(socket.AF_UNIX); line.settimeout(60); line.connect(where); return line
for order in sys.stdin:
    verb, name, text = (order.split() + [""])[:3]
    if verb == "CONNECT":
        try: lines[name] = connect()
        except ConnectionError: lines[name] = None  # reset as it was made
    elif verb == "SEND" and lines[name]:
        try: lines[name].sendall(text.encode())
        except ConnectionError: pass  # what is expected next tells
    elif verb == "CLOSE" and lines[name]: lines.pop(name).close()
    elif verb == "EXPECT":
        if not lines[name]: sys.exit(f"{name}: reset as it was made, expected {text}")
        got = b""
        while len(got) < len(text):
            more = lines[name].recv(len(text) - len(got))
            if not more: sys.exit(f"{name}: the line ended after {got}")
            got += more
        if got != text.encode(): sys.exit(f"{name}: got {got}, expected {text}")
    elif verb == "OVER" and lines[name]:
        try:
            if lines[name].recv(100): sys.exit(f"{name}: bytes came, and no end")
        except ConnectionError: pass
END
client() { timeout 120 "$PYTHON" client.py "$@" || die "the client failed: $(cat log)"; }

# begin_client: a client that takes its orders from $to_client, until end_client.
begin_client() {
  coproc client "$driver"
  client=$COPROC_PID to_client=${COPROC[1]} # both variables go when it ends
}
end_client() {
  exec {to_client}>&-
  wait "$client" || die "the client failed: $(cat log)"
}

# The device answers each byte with itself, on each of its connections.
start socat "TCP-LISTEN:$device,bind=127.0.0.1,fork,reuseaddr" EXEC:cat
wait_listening "$device"

# recorder OPTION…, replayer OPTION…: sets $daemon; done_with STATUS: ends it.
recorder() {
  start "$PORTTAPED" record --device "tcp:127.0.0.1:$device" --driver "tcp-listen:127.0.0.1:$driver" "$@" 2>log
  daemon=$started
  wait_listening "$driver" log
}
replayer() {
  start "$PORTTAPED" replay --driver "tcp-listen:127.0.0.1:$driver" "$@" 2>log
  daemon=$started
  wait_listening "$driver" log
}
done_with() {
  kill -TERM "$daemon"
  ended "$daemon" || die "the daemon does not end: $(cat log)"
  status_of "$daemon"
  [[ $status == "$1" ]] || die "exit $status, expected $1: $(cat log)"
}

recorder --tape one
client "$driver" <<'END'
CONNECT first
SEND first a
EXPECT first a
CONNECT second
SEND second NO
OVER second
SEND first b
EXPECT first b
CLOSE first
CONNECT third
SEND third c
EXPECT third c
END
done_with 0
[[ $(payload one.logw) == abc ]] || die "the device got other bytes than those of the drivers that were served: $(payload one.logw)"
grep -q 'is refused: 127.0.0.1:.* is connected' log || die "the refused driver is not told: $(cat log)"
say "one at a time: the second is refused and told, the next is served"

for ((n = 0; n < 20; n++)); do printf 'CONNECT d\nSEND d x\nEXPECT d x\nCLOSE d\n'; done >fast
recorder --tape fast
client "$driver" <fast
done_with 0
! grep -q refused log || die "a fast reconnect was refused: $(cat log)"
say "one at a time: a driver that comes again at once is served, 20 times"

orders='CONNECT a
SEND a 1
EXPECT a 1
CONNECT b
SEND b 2
EXPECT b 2
SEND a 3
EXPECT a 3
CLOSE b
SEND a 4
EXPECT a 4'
recorder --tape each --connections each
client "$driver" <<<"$orders"
done_with 0
[[ $(payload each.logw) == 134 && $(payload each.c2.logw) == 2 ]] || die "the tapes have other bytes: $(ls) $(cat log)"
"$PYTHON" - <<'END' || die "the tapes do not begin together: $(head -n 2 each.loge each.c2.loge)"
import json, sys
def tape(name): return [json.loads(line) for line in open(name)]
def zero(lines): return [line.get("zero") for line in lines if "zero" in line][-1]
def opened(lines): return [line["t_us"] for line in lines if line.get("event") == "open"]
one, two = tape("each.loge"), tape("each.c2.loge")
sys.exit(not (zero(one) == zero(two) and opened(one) == [0] and opened(two)[0] > 0))
END
say "each: two tapes with one zero"

replayer --tape each --connections each
client "$driver" <<END
$orders
CONNECT c
OVER c
END
done_with 0
grep -q 'connection 3 of .* is refused' log || die "one too many is not told: $(cat log)"
say "each, replayed: the k-th connection meets the k-th tape, one too many is refused"

replayer --tape each --connections each --once --report report
client "$driver" <<'END'
CONNECT a
SEND a 1
EXPECT a 1
CONNECT b
SEND b 9
CLOSE b
SEND a 3
SEND a 4
END
status_of "$daemon"
[[ $status == 3 ]] || die "one wrong of two: exit $status, expected 3: $(cat log)"
[[ $(json report runs.worst) == data-mismatch && $(json report runs.count) == 2 && $(json report exit) == 3 ]] ||
  die "the report has not both runs: $(cat report)"
say "each, replayed: the worst verdict counts"

replayer --tape each --connections each --once
client "$driver" <<'END'
CONNECT a
SEND a 1
EXPECT a 1
SEND a 3
EXPECT a 3
SEND a 4
EXPECT a 4
END
done_with 5
grep -q 'no connection came for the tape each.c2.log' log || die "a tape that nobody came for is not told: $(cat log)"
say "each, replayed: a connection that never came is missing"

try "$PORTTAPE" test --tape each --driver "tcp-listen:127.0.0.1:$driver" --connections each --timeout 60 -- \
  bash -c "\"$PYTHON\" client.py $driver <<<\"$orders\"" >out 2>&1
[[ $status == 0 ]] || die "porttape test: exit $status: $(cat out)"
say "each, under porttape test"

orders_of_three=${orders/SEND b 2/$'CONNECT c\nOVER c\nSEND b 2'}
try "$PORTTAPE" test --tape each --driver "tcp-listen:127.0.0.1:$driver" --connections each --timeout 60 -- \
  bash -c "\"$PYTHON\" client.py $driver <<<\"$orders_of_three\"" >out 2>&1
[[ $status == 0 ]] || die "one too many under porttape test: exit $status: $(cat out)"
[[ $(<out) == *"pass, with doubts"* && $(<out) == *"connection 3 came and was turned away, since 2 were recorded"* ]] ||
  die "one too many is no doubt: $(cat out)"
say "each, under porttape test: one too many is a doubt of the outcome"

recorder --tape each --connections each --on-existing next
client "$driver" <<<"$orders"
done_with 0
[[ -e each.2.logr && -e each.2.c2.logr && ! -e each.2.c3.logr ]] || die "the second group is not named: $(ls)"
try "$PORTTAPED" record --device "tcp:127.0.0.1:$device" --driver "tcp-listen:127.0.0.1:$driver" --tape each --connections each 2>log
[[ $status == 2 ]] || die "a group that is there was not refused: $(cat log)"
touch each.c7.logr each.c7.logw
try "$PORTTAPED" record --device "tcp:127.0.0.1:$device" --driver "tcp-listen:127.0.0.1:$driver" --tape each --connections each \
  --overwrite 2>log
[[ $status == 2 ]] || die "--overwrite where a tape is of nobody knows what: exit $status: $(cat log)"
grep -qF "'each.c7.log' is not of the recording 'each.log', which is to be replaced" log || die "that is not told: $(cat log)"
[[ -e each.c7.logr && -e each.c2.logr && -e each.logr ]] || die "something is gone: $(ls)"
rm each.c7.logr each.c7.logw
recorder --tape each --connections each --overwrite
client "$driver" <<<$'CONNECT a\nSEND a z\nEXPECT a z'
done_with 0
[[ $(payload each.logw) == z && ! -e each.c2.logr ]] || die "the older group is not gone: $(ls)"
say "each: a group never mixes with an older one"

recorder --tape turned --connections each
begin_client
printf 'CONNECT a\nSEND a 1\nEXPECT a 1\nCONNECT b\nSEND b 2\nEXPECT b 2\n' >&"$to_client"
has_payload() { [[ $(payload "$1" 2>/dev/null) == "$2" ]]; }
until_true has_payload turned.c2.logw 2 || die "no second tape: $(cat log)"
kill -USR1 "$daemon"
for tape in turned.2 turned.2.c2; do wait_for $tape.loge log; done
printf 'SEND a 3\nEXPECT a 3\nCONNECT c\nSEND c 4\nEXPECT c 4\n' >&"$to_client"
end_client
done_with 0
[[ $(payload turned.2.logw) == 3 && $(payload turned.2.c3.logw) == 4 ]] || die "the next tapes: $(ls)"
say "each: a rotation begins the next tapes of all"

start "$PORTTAPED" bridge --device "tcp:127.0.0.1:$device" --driver "unix-listen:$work/socket" --connections each 2>log
daemon=$started
wait_listening "$work/socket" log
client "$work/socket" <<<"$orders"
done_with 0
say "each, a bridge on a Unix socket"

cat >channels.conf <<END
[channel each]
device = tcp:127.0.0.1:$device
driver = tcp-listen:127.0.0.1:$driver
tape = run
connections = each
END
start "$PORTTAPED" run channels.conf 2>log
daemon=$started
wait_listening "$driver" log
client "$driver" <<<"$orders"
done_with 0
[[ $(payload run.c2.logw) == 2 ]] || die "run: $(ls)"
say "each, in a configuration"

wrong() { # EXPECTED-TEXT ARGUMENT…
  local text=$1
  shift
  try timeout 120 "$PORTTAPED" "$@" 2>log
  [[ $status == 2 ]] || die "$*: exit $status"
  grep -q "$text" log || die "$*: $(cat log)"
}
wrong 'pty:.* does not' record --device "tcp:127.0.0.1:$device" --driver "pty:$work/p" --tape x --connections each
wrong 'can be open once' record --device /dev/null --driver "tcp-listen:127.0.0.1:$driver" --tape x --connections each
wrong 'only one can have' bridge --device tcp-listen:2000 --driver "tcp-listen:127.0.0.1:$driver" --connections each
say "a port that has no connections, or a device that has one, is a usage error"

# Descriptors for some of them: the others are told, and wait or are refused; who is there is served.
if [[ -n ${SANITIZE:-} ]]; then
  say "more connections than descriptors: left out, the sanitizers need descriptors themselves"
  exit 0
fi
start bash -c 'ulimit -n 60; exec "$@"' bash "$PORTTAPED" bridge --device "tcp:127.0.0.1:$device" \
  --driver "tcp-listen:127.0.0.1:$driver" --connections each 2>log
daemon=$started
wait_listening "$driver" log
begin_client
{
  printf 'CONNECT a\nSEND a 1\nEXPECT a 1\n'
  for ((n = 0; n < 60; n++)); do printf 'CONNECT f%d\n' "$n"; done
} >&"$to_client"
until_true grep -qi 'too many open files' log || die "the limit is not told: $(cat log)"
{
  printf 'SEND a 2\nEXPECT a 2\n'
  for ((n = 0; n < 60; n++)); do printf 'CLOSE f%d\n' "$n"; done
  printf 'SEND a 3\nEXPECT a 3\n'
} >&"$to_client"
end_client
# Those that waited are accepted and closed one by one: until then there are no descriptors for another.
another() { printf 'CONNECT b\nSEND b 4\nEXPECT b 4\n' | timeout 120 "$PYTHON" client.py "$driver" 2>/dev/null; }
until_true another || die "nobody is served once there are descriptors again: $(cat log)"
done_with 0
say "each: more connections than descriptors"
