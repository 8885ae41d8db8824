#!/bin/bash
# faults.sh: faults on the line of a device: the driver has them, the tape tells of them, the same seed makes the same.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need "$PYTHON"
cd "$work"

# Answers each line with 60 bytes.
start "$PYTHON" -c '
import socket, threading
server = socket.socket(socket.AF_UNIX)
server.bind("device")
server.listen()
def serve(line):
    while line.recv(100):
        line.sendall(bytes(range(48, 107)) + b"\n")
while True:
    threading.Thread(target=serve, args=(server.accept()[0],), daemon=True).start()
'
until_true test -S device || die "no device"
cat >driver.py <<'END'
import os, sys, termios, tty
def asked(port):
    """What comes for one question, until nothing comes for a second, or the line is gone."""
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(fd)
    line = termios.tcgetattr(fd)
    line[6][termios.VMIN], line[6][termios.VTIME] = 0, 10
    termios.tcsetattr(fd, termios.TCSANOW, line)
    os.write(fd, b"?\n")
    got = b""
    try:
        while part := os.read(fd, 1000):
            got += part
    except OSError:
        got += b"<gone>"
    os.close(fd)
    return got
for _ in range(int(sys.argv[2])):
    print(asked(sys.argv[1]).decode("latin-1"), flush=True)
END
plan='drop:byte=3;corrupt:byte=5,xor=20,dir=r;duplicate:byte=7,dir=r,burst=2;drop:p=0.05,dir=r'
for n in 1 2; do
  try "$PORTTAPE" record --device unix:device --tape "live$n" --faults "$plan" --seed 7 -- "$PYTHON" driver.py '{port}' 1 >"got$n"
  [[ $status == 0 ]] || die "record ends with $status"
done
cmp got1 got2 || die "the same seed made other faults"
grep -q '^0124' got1 || die "byte 3 is there: $(cat got1)"
diff <("$PORTTAPE" cat live1 | grep -o 'fault.*') <("$PORTTAPE" cat live2 | grep -o 'fault.*') || die "not told alike"
"$PORTTAPE" cat live1 | grep -q 'fault .*"kind":"corrupt","dir":"r","offset":5,"spec":"corrupt:byte=5:dir=r:xor=20"' \
  || die "the tape does not tell: $("$PORTTAPE" cat live1)"
"$PORTTAPE" cat live1 | grep -q 'fault .*"kind":"plan".*"seed":7' || die "the tape has no plan"
"$PORTTAPE" info live1 | grep -q '^ *faults .* drop' || die "info does not tell: $("$PORTTAPE" info live1)"
"$PORTTAPE" info live1 | grep -q 'by drop:byte=3:dir=both;.*; seed 7$' || die "info does not tell the plan"
"$PORTTAPE" verify live1 | grep -q ': sound' || die "a tape with faults is not sound: $("$PORTTAPE" verify live1)"
try "$PORTTAPE" test --tape live1 -- "$PYTHON" driver.py '{port}' 1 >got3
[[ $status == 0 ]] || die "the tape is not the line as it was: $(cat got3)"
cmp <(head -n 1 got1) <(head -n 1 got3) || die "the tape plays something else"

# The line breaks, and is there again.
try "$PORTTAPE" record --device unix:device --tape broken --faults 'hangup:byte=10,dir=r' --seed 1 -- "$PYTHON" driver.py '{port}' 2 \
  >gone 2>said
[[ $status == 6 ]] || die "record ends with $status, and the device was lost"
grep -q '^0123456789<gone>$' gone || die "the line did not break behind its byte: $(cat gone)"
grep -q '^0123456789:;' gone || die "it is not there again: $(cat gone)"
grep -q 'unplugged by the fault hangup:byte=10:dir=r' said || die "not told: $(cat said)"
"$PORTTAPE" cat broken | grep -q 'device-lost .*"hung_up":true' || die "the tape does not tell of the break"

# On a tape: in its report.
try "$PORTTAPE" test --tape live1 --faults 'drop:byte=0' --seed 9 --report report.json -- "$PYTHON" driver.py '{port}' 1 >got4
grep -q 'faults    1 made (1 drop) by drop:byte=0:dir=r; seed 9' got4 || die "the verdict does not tell: $(cat got4)"
grep -q '"faults":{"plan":"drop:byte=0:dir=r","seed":9,"made":1' report.json || die "the report does not: $(cat report.json)"
