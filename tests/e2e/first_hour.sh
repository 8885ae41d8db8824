#!/bin/bash
# first_hour.sh: what a new user does with a device made by oneself and a script that uses pyserial: a tape by one command, a
# test, then a driver that writes a wrong byte and one that is slow. The cause stands at the top of what is said.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need "$PYTHON"
"$PYTHON" -c 'import serial' 2>/dev/null || die "no pyserial; ./check installs it"
mkdir "$work/empty"
cd "$work/empty"
unset PORTTAPE_PORT NO_COLOR

# A thermometer on a pty: answers T<n> with a reading.
cat >device.py <<'END_OF_DEVICE'
import os, tty
master, slave = os.openpty()
tty.setraw(slave)
os.symlink(os.ttyname(slave), "thermometer")
line = b""
while True:
    line += os.read(master, 100)
    while b"\n" in line:
        request, _, line = line.partition(b"\n")
        os.write(master, b"%s=%d.5 C\n" % (request, 20 + int(request[1:])))
END_OF_DEVICE
# The driver finds its port as a user would name it: by an argument, or the environment.
cat >driver.py <<'END_OF_DRIVER'
import os, sys, time, serial
port = serial.Serial(os.environ["PORTTAPE_PORT"], 9600, timeout=60)
requests = sys.argv[1].split(",")
for request in requests:
    if request.startswith("wait"):
        time.sleep(float(request[4:]))
        continue
    port.write(request.encode() + b"\n")
    answer = port.readline().decode().strip()
    print(answer or "no answer")
    if not answer: sys.exit(1)
END_OF_DRIVER
start "$PYTHON" device.py
wait_for thermometer

"$PORTTAPE" record --device serial:thermometer --tape first -- "$PYTHON" driver.py T1,T2,T3 >out 2>said || die "record: $(cat said)"
[[ $(cat out) == $'T1=21.5 C\nT2=22.5 C\nT3=23.5 C' ]] || die "recorded: $(cat out)"
grep -q first said || die "not told what is on the tape: $(cat said)"
"$PORTTAPE" verify first >out || die "verify: $(cat out)"

"$PORTTAPE" test --tape first -- "$PYTHON" driver.py T1,T2,T3 >out 2>&1 || die "the same driver: $(cat out)"

# The driver's own words go elsewhere: what is left in `out` is porttape's.
quietly=(sh -c 'exec "$@" >said 2>&1' sh "$PYTHON" driver.py)
# first_five PATTERN…: each stands in the first five lines that porttape says.
first_five() {
  local pattern
  without_doubts out | sed -n 1,5p >top
  for pattern; do grep -qE -- "$pattern" top || die "not in the first five lines: $pattern"$'\n'"$(cat out)"; done
}

try "$PORTTAPE" test --tape first -- "${quietly[@]}" T1,X2,T3 >out 2>&1
[[ $status == 3 ]] || die "a wrong byte: status $status: $(cat out)"
first_five 'data mismatch' '"X' '"T2' 'byte 3'
grep -m1 -E '"X|byte 3' top | grep -q '"X' || die "the offset comes before the text: $(cat top)"

try "$PORTTAPE" test --tape first --strictness 2 --jitter 150 -- "${quietly[@]}" T1,T2,wait0.6,T3 >out 2>&1
[[ $status == 4 ]] || die "a slow command: status $status: $(cat out)"
first_five 'timing mismatch' '"T3' 'late'

try "$PORTTAPE" test --tape first -- "${quietly[@]}" T1,T2 >out 2>&1
[[ $status == 5 ]] || die "a request left out: status $status: $(cat out)"
first_five 'incomplete' '"T3'
say "a tape, a test, three changed drivers"
