#!/bin/bash
# drive.sh: `porttape drive`: tapes of a driver with its simulated device, driven against the device again, at every
# timing; on a tty, TCP, a unix socket and UDP, and to one that comes to us. A device that answers otherwise, a silent one, one
# whose answers vary by rules, and Ctrl-C.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
cd "$work"

# The sensor answers the same requests the same way only when it has just been started.
sensor() {
  stop "${sensor:-}" 2>/dev/null || true
  start "$devices/scip_sensor.py" "$work/line.far" --seed "${1:-1}"
  sensor=$started
  until_true has_open "$sensor" "$work/line.far" || die "the sensor does not open its line"
  until_true has_set_up || die "the sensor does not set its line up"
}
has_set_up() { stty -F "$work/line.far" -a | grep -q -- ' -icanon'; }
device=serial:$work/line.near

# drive STATUS TAPE OPTION…: what it says is in `out` and `said`.
drive() {
  local want=$1 tape=$2
  shift 2
  try "$PORTTAPE" drive "$tape" "$@" >out 2>said
  [[ $status == "$want" ]] || die "status $status instead of $want: drive $tape $* $(cat out said)"
}
says() { without_doubts out | sed -n 1,5p | grep -E -- "$1" >/dev/null || die "no /$1/ in the first five lines of: $(cat out said)"; }
timings=(reactive recorded none)
passes() { # TAPE DEVICE BEFORE…: at every timing; BEFORE makes the device ready
  local timing tape=$1 port=$2
  shift 2
  for timing in "${timings[@]}"; do
    "$@"
    drive 0 "$tape" --device "$port" --timing "$timing" --report report.json
    verdict_is pass report.json
    [[ $(json report.json to_driver.matched) == "$(json report.json to_driver.of)" ]] || die "$(cat report.json)"
  done
}

line_pair line
sensor
"$PORTTAPE" record --device "$device,baud=115200" --tape laser -- "$devices/scip_client.py" '{port}' >/dev/null 2>said ||
  die "no tape: $(cat said)"
# By the clock it would be chance whether the last scan or the request to stop comes first.
timings=(reactive none)
passes laser "$device" sensor
timings=(reactive recorded none)
sensor
drive 0 laser --device "$device" --timing none --rate 10

# It has a tty of its own, another one each time it is started.
scale() {
  stop "${scale:-}" 2>/dev/null || true
  rm -f place
  start "$e2e/../defects/device/scale_device.py" >place
  scale=$started
  until_true test -s place || die "the scale does not start"
  ln -sf "$(<place)" "$work/scale"
}
scale
"$PORTTAPE" record --device "serial:$work/scale" --tape weights -- "$e2e/../defects/device/scale_driver.py" '{port}' >/dev/null 2>said ||
  die "no tape: $(cat said)"
passes weights "serial:$work/scale" scale
say "ok: ttys, at every timing"

# Another box in the room: other ranges.
sensor 2
drive 3 laser --device "$device" --timing none
says '^data mismatch: the device sent '
sensor
kill -STOP "$sensor"
drive 5 laser --device "$device" --timeout 1
says '^incomplete: the device was silent for 1 s'
kill -CONT "$sensor"

# By a signal; the report says how far it came.
sensor
kill -STOP "$sensor"
start "$PORTTAPE" drive laser --device "$device" --report report.json >out 2>said
until_true has_open "$started" "$work/line.near" || die "the device is not opened: $(cat said)"
kill -INT "$started"
ended "$started" || die "SIGINT does not end it"
status_of "$started"
[[ $status == 130 ]] || die "after SIGINT status $status: $(cat out said)"
says '^interrupted by SIGINT'
verdict_is incomplete report.json
say "ok: other bytes, silence, a signal"

tcp='' udp=''
free_ports tcp udp
start socat "TCP-LISTEN:$tcp,bind=127.0.0.1,reuseaddr,fork" 'EXEC:cat'
wait_listening "$tcp"
start socat "UNIX-LISTEN:$work/echo,fork" 'EXEC:cat'
wait_for echo
start socat "UDP-RECVFROM:$udp,bind=127.0.0.1,fork" 'SYSTEM:tr a-z A-Z'
until_true listens_on "$udp" || die "nobody listens on UDP $udp"
talk='import sys
sys.path.insert(0, sys.argv[1])
from line import Line
line = Line(sys.argv[2])
for word in (b"one\n", b"two\n", b"a longer one\n"):
    line.write(word)
    assert line.read_until(b"\n", 60).lower() == word'
for port in "tcp:127.0.0.1:$tcp" "unix:$work/echo" "udp:127.0.0.1:$udp,recv_port=0"; do
  "$PORTTAPE" record --device "$port" --tape echo --overwrite -- "$PYTHON" -c "$talk" "$devices" '{port}' >/dev/null 2>said ||
    die "no tape of $port: $(cat said)"
  # This server of UDP may answer in another order, where it is not waited for.
  [[ $port != udp:* ]] || timings=(reactive none)
  passes echo "$port" true
done
say "ok: TCP, a unix socket, UDP"

# One that comes to us.
"$PORTTAPE" record --device "tcp:127.0.0.1:$tcp" --tape echo --overwrite -- "$PYTHON" -c "$talk" "$devices" '{port}' >/dev/null 2>said ||
  die "no tape: $(cat said)"
start "$PORTTAPE" drive echo --device "pty:$work/own" --timeout 20 >out 2>said
driven=$started
wait_for own said
start socat "FILE:$work/own,raw,echo=0" 'EXEC:cat'
status_of "$driven"
[[ $status == 0 ]] || die "to a device that comes to us: status $status: $(cat out said)"
say "ok: a pty of our own"

# Answers with the time in them, and a word.
cat >clock.py <<'EOF'
import socketserver, sys, time
class Clock(socketserver.StreamRequestHandler):
    def handle(self):
        for _ in self.rfile:
            self.wfile.write(b"N=%d;%s\n" % (time.time_ns(), sys.argv[2].encode()))
socketserver.ThreadingTCPServer.allow_reuse_address = True
socketserver.ThreadingTCPServer(("127.0.0.1", int(sys.argv[1])), Clock).serve_forever()
EOF
cat >clock.rules <<'EOF'
format = 'porttape-rules'
version = 1
[[frame]]
name = 'line'
kind = 'delimited'
end = "\n"
[[rule]]
name = 'time'
frame = 'line'
capture = 'N=(\d+);'
regex = '\d+'
length = [1, 25]
EOF
good='' bad=''
free_ports good bad
start "$PYTHON" clock.py "$good" fine
start "$PYTHON" clock.py "$bad" fire
wait_listening "$good"
wait_listening "$bad"
# shellcheck disable=SC2016 # of the inner shell
"$PORTTAPE" record --device "tcp:127.0.0.1:$good" --tape clock -- \
  bash -c 'exec 3<>"$0"; for word in a b c; do echo "$word" >&3; read -r line <&3; done' '{port}' 2>said || die "no tape: $(cat said)"
drive 3 clock --device "tcp:127.0.0.1:$good"
drive 0 clock --device "tcp:127.0.0.1:$good" --rules clock.rules
drive 3 clock --device "tcp:127.0.0.1:$bad" --rules clock.rules
say "ok: answers that vary, by rules"
