#!/bin/bash
# record.sh: `porttape record`, one command to a tape: with a simulated sensor, as a user types it.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
cd "$work"
line_pair line
start "$devices/scip_sensor.py" "$work/line.far"
sensor=$started
has_set_up() { [[ $(stty -F "$work/line.far" speed) == 115200 ]]; } # the last that the sensor does before it listens
until_true has_set_up || die "the sensor does not set its line up"
device=serial:$work/line.near
cat >laser.py <<'EOF'
import sys, time, serial
line = serial.Serial(sys.argv[1], 115200, timeout=60)
for request in sys.argv[2:]:
    if request == "pause":
        time.sleep(0.4)
        continue
    line.write(request.encode() + b"\n")
    while line.readline() not in (b"\n", b""):
        pass
EOF

# record STATUS TAPE COMMAND…: what it says is in $work/said; nothing of its own goes to stdout.
record() {
  local want=$1 tape=$2
  shift 2
  try "$PORTTAPE" record --device "$device" --tape "$tape" "${options[@]}" -- "$@" >out 2>said
  [[ $status == "$want" ]] || die "status $status instead of $want: $* $(cat said)"
}
options=()
said() { grep -qF -- "$1" said || die "not told '$1': $(cat said)"; }
whole() {
  "$PORTTAPE" verify "$1" >verified || die "$1: $(cat verified)"
  grep -q 'sound' verified || die "$1: $(cat verified)"
}
type_next() { # the line that it says to type
  local next
  # shellcheck disable=SC2016 # for eval
  next=$(sed -n 's/^  test with it  porttape/"$PORTTAPE"/p' said)
  eval "$next" >out 2>&1 || die "'$next' gives $?: $(cat out)"
}
no_tape() { [[ ! -e $1.logr && ! -e $1.logw && ! -e $1.loge ]] || die "there is a tape $1"; }

# The first tape, and the line that it says to type next.
record 0 first "$PYTHON" laser.py '{port}' VV PP II
said 'first.log: 3 exchanges in '
[[ ! -s out ]] || die "on stdout: $(cat out)"
whole first
"$e2e/compare_tap.sh" first line scip
type_next
grep -q '^pass[ ,]' out || die "no pass: $(cat out)"

# What differs stands in the first five lines.
cause() { # STATUS LINE OPTION… -- COMMAND…
  local want=$1 line=$2
  shift 2
  try "$PORTTAPE" test --tape first "$@" >out 2>said
  [[ $status == "$want" ]] || die "status $status instead of $want: $(cat out said)"
  without_doubts out | sed -n 1,5p | grep -E -- "$line" >/dev/null || die "no /$line/ in the first five lines of: $(cat out)"
}
cause 3 'the driver wrote "PQ\\n" where the tape has "PP\\n"' -- "$PYTHON" laser.py '{port}' VV PQ II
cause 4 'timing mismatch: "(VV|PP|II)\\n" came [0-9.]+ ms later than recorded \(100 ms allowed\)$' \
  --strictness 2 -- "$PYTHON" laser.py '{port}' VV PP pause II
cause 5 'incomplete: the driver never wrote "II\\n"' -- "$PYTHON" laser.py '{port}' VV PP
cause 3 'extra: the driver wrote "BM\\n" where the tape has nothing more' -- "$PYTHON" laser.py '{port}' VV PP II BM
cause 1 'failed: the driver did all as recorded, but the command ended with status 7$' -- \
  bash -c "$PYTHON laser.py {port} VV PP II; exit 7"
cause 1 'but the command was ended by SIGSEGV \(11\)$' -- bash -c "$PYTHON laser.py {port} VV PP II; kill -SEGV \$\$"

# Ended before it is through: by a signal to porttape, by one of its own.
start "$PORTTAPE" record --device "$device" --tape ended -- \
  bash -c "$PYTHON laser.py {port} VV; touch asked; exec sleep 1000" 2>said
wait_for asked said
kill -TERM "$started"
ended "$started" || die "SIGTERM does not end it"
status_of "$started"
[[ $status == 143 ]] || die "after SIGTERM status $status: $(cat said)"
whole ended
record 139 killed bash -c "$PYTHON laser.py {port} VV; kill -SEGV \$\$"
said 'the command was ended by SIGSEGV (11)'
whole killed

# Ctrl-C in a terminal: the command gets it once, and may do what it likes; the tape is whole.
cat >interrupted.py <<'EOF'
import signal, sys, time, serial
came = 0
def interrupt(*_):
    global came
    came += 1
signal.signal(signal.SIGINT, interrupt)
line = serial.Serial(sys.argv[1], 115200, timeout=60)
def ask():
    line.write(b"VV\n")
    while line.readline() not in (b"\n", b""):
        pass
ask()
print("ready", flush=True)
while came == 0:
    time.sleep(0.02)
for _ in range(3):  # a second one would come with the first bytes through porttape
    ask()
sys.exit(100 + came)
EOF
cat >terminal.py <<'EOF'
import os, pty, sys
pid, terminal = pty.fork()
if pid == 0:
    os.execv(sys.argv[1], sys.argv[1:])
seen, sent = b"", False
while True:
    try:
        data = os.read(terminal, 4096)
    except OSError:
        break
    if not data:
        break
    seen += data
    if b"ready" in seen and not sent:
        os.write(terminal, b"\x03")
        sent = True
status = os.waitpid(pid, 0)[1]
sys.stderr.write(seen.decode(errors="replace"))
sys.exit(os.waitstatus_to_exitcode(status))
EOF
try timeout -k 5 120 "$PYTHON" terminal.py "$PORTTAPE" record --device "$device" --tape interrupted -- \
  "$PYTHON" interrupted.py '{port}' 2>said
[[ $status == 101 ]] || die "after Ctrl-C status $status: $(cat said)"
whole interrupted
said '4 exchanges'
try timeout -k 5 120 "$PYTHON" terminal.py "$PORTTAPE" test --tape interrupted -- "$PYTHON" interrupted.py '{port}' 2>said
[[ $status == 130 ]] || die "test after Ctrl-C: status $status: $(cat said)"
said 'interrupted by SIGINT (2)'

# Refused before the command starts.
record 2 first touch ran
said '--overwrite'
record 2 no/such/folder touch ran
present=$device device=serial:$work/no_device
record 6 new touch ran
said 'no_device'
device=$present
options=(--strict 1)
record 2 new touch ran
options=()
[[ ! -e ran ]] || die "a command ran that was not to"
record 2 new no-such-program '{port}'
said "command 'no-such-program' cannot be run"
no_tape new

# Not to be taken for a success.
record 0 new true
said 'the command never opened its port, so that there is no tape'
record 0 new "$PYTHON" laser.py "$work/line.near" VV
said "-- $PYTHON laser.py {port} VV"
no_tape new

# A tape that its disk does not take: told, and never status 0; with --fail-closed it is the command's end.
read -ra large <<<"$(printf 'VV %.0s' {1..60})"
limited() { (ulimit -f 4; record "$@"); }
limited 1 small "$PYTHON" laser.py '{port}' "${large[@]}"
said 'small.log'
said 'missing'
options=(--fail-closed)
limited 1 closed bash -c "$PYTHON laser.py {port} ${large[*]}; exec sleep 1000"
said 'the line had to end'
options=()

# Sockets: a device that is one, under a port that the system chooses.
stop "$sensor"
free_ports number
# shellcheck disable=SC2154 # free_ports sets it
start socat "TCP-LISTEN:$number,bind=127.0.0.1,fork,reuseaddr" "EXEC:sed -u s/ask/answer/"
wait_listening "$number"
device=tcp:127.0.0.1:$number
options=(--driver tcp-listen:127.0.0.1:0)
# shellcheck disable=SC2016
ask='exec 3<>"/dev/tcp/$PORTTAPE_HOST/$PORTTAPE_TCP_PORT"; echo ask >&3; read -r got <&3; [[ $got == answer && $1 == $PORTTAPE_PORT ]]'
record 0 socket bash -c "$ask" ask '{host}:{tcp_port}'
said '4 bytes in 1 block from the command, 7 bytes in 1 block from the device'
whole socket
type_next
stop "$started"
record 6 gone bash -c "$ask || true" ask '{port}'
said "127.0.0.1:$number"

say "recorded, interrupted, refused, limited"

# A device that takes its time gets all that a command wrote before it ended, though a pty and porttape held it by then.
cat >slow.py <<'EOF'
import os, sys, time, tty
master, slave = os.openpty()
tty.setraw(slave)
os.symlink(os.ttyname(slave), sys.argv[1])
with open(sys.argv[2], "wb", 0) as got:
    while True:
        got.write(os.read(master, 100))
        time.sleep(0.002)
EOF
start "$PYTHON" slow.py "$work/slow" "$work/slow.got"
wait_for "$work/slow"
device=serial:$work/slow
all_came() { [[ $(wc -c <slow.got) == $((39000 * rounds)) ]]; }
rounds=0
for supervised in no yes; do
  options=()
  [[ $supervised == no ]] || options=(--exec)
  record 0 "slow$rounds" "$PYTHON" -c 'import os, sys, tty
line = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
tty.setraw(line)
left = b"0123456789" * 3900
while left:
    left = left[os.write(line, left):]' '{port}'
  whole "slow$rounds"
  rounds=$((rounds + 1))
  until_true all_came || die "the slow device got $(wc -c <slow.got) of $((39000 * rounds)) bytes"
done
options=()
say "a slow device gets what was written before the end"
