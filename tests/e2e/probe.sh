#!/bin/bash
# probe.sh: `porttape probe` with a program that does to a pty all that one lacks or bends.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need python3
cd "$work"
cat >program.py <<'END'
import fcntl, os, pty, sys, termios
master, slave = pty.openpty()
def ask(request, argument):
    try:
        fcntl.ioctl(slave, request, argument)
    except OSError:
        pass
for request in (0x5415, 0x5418, 0x5416, 0x5417, 0x545C, 0x545D, 0x541E, 0x541F, 0x542E, 0x542F):
    ask(request, b"\0" * 128)
for request, number in ((0x5409, 0), (0x5409, 1), (0x5425, 1), (0x5427, 0), (0x5428, 0), (0x540B, 2), (0x540C, 0), (0x540D, 0)):
    ask(request, number)
modes = termios.tcgetattr(slave)
modes[2] = modes[2] & ~termios.CSIZE | termios.CS7 | termios.PARENB | termios.CSTOPB | termios.CRTSCTS
try:
    termios.tcsetattr(slave, termios.TCSAFLUSH, modes)
except termios.error:
    pass
for name in ("/sys/class/tty/ttyUSB7/device/latency_timer", "/sys/class/tty", "/dev/ttyUSB7", "/dev/ttyUSB7", "/sys/bus/usb/devices",
             "/run/udev/data", "/dev/serial/by-id", "/var/lock/LCK..ttyUSB7"):
    os.path.exists(name)
print("said by the command")
sys.exit(int(sys.argv[1]))
END
program=(python3 program.py)

# row CALL TIMES EFFECT: is in the report.
row() { grep -Eq "^  $1 +$2 +[0-9.]+ s  $3 " report || die "no row '$1' $2 times, $3: $(cat report)"; }

try "$PORTTAPE" probe -- "${program[@]}" 5 >report 2>said </dev/null
[[ $status == 5 ]] || die "exit $status, not the command's 5: $(cat report said)"
grep -q '^port /dev/pts/[0-9]* (a pty)$' report || die "no port: $(cat report)"
for call in TIOCMGET TIOCMSET TIOCMBIS TIOCMBIC TIOCMIWAIT TIOCGICOUNT TIOCGSERIAL TIOCSSERIAL TIOCGRS485 TIOCSRS485; do
  row "$call" 1 lacks
done
for call in 'TCSBRK \(break\)' 'TCSBRK \(drain\)' TCSBRKP TIOCSBRK TIOCCBRK TCFLSH parity '5 to 7 data bits' 'RTS/CTS flow control'; do
  row "$call" 1 bends
done
row latency_timer 1 finds
row 'looks in /sys/class/tty' 1 finds
row 'names /dev/ttyUSB7' 2 finds
row 'looks in /sys/bus/usb\*' 1 finds
row 'asks udev' 1 finds
row 'looks in /dev/serial' 1 finds
for call in TIOCEXCL '2 stop bits' 'lock file LCK..'; do row "$call" 1 same; done
grep -qF 'remedy  porttape exec --device PORT --tape NAME --as /dev/ttyUSB7 -- python3 program.py 5' report || die "no remedy: $(cat report)"
say "all that a pty lacks or bends, and the line that mends it"

try "$PORTTAPE" probe --json -- "${program[@]}" 0 >report 2>said </dev/null
[[ $status == 0 ]] || die "--json: exit $status: $(cat report said)"
grep -q 'said by the command' said || die "the command's output is not on stderr"
python3 - <<'END' || die "--json: $(cat report)"
import json
told = json.load(open("report"))
calls = {call["call"]: call for call in told["calls"]}
assert calls["TIOCMGET"]["effect"] == "lacks" and calls["names /dev/ttyUSB7"]["count"] == 2
assert told["ports"][0]["pty"] is True and told["command_exit"] == 0 and " --as /dev/ttyUSB7 " in told["remedy"]
END
say "the same as JSON"

try "$PORTTAPE" probe -- true >report 2>said </dev/null
{ [[ $status == 0 ]] && grep -q 'nothing that a pty lacks' report; } || die "true: exit $status: $(cat report said)"
# A port that the command line names is {port}, and no reason for a supervisor.
try "$PORTTAPE" probe -- test -e /dev/ttyUSB7 >report 2>said </dev/null
{ [[ $status == 1 ]] && grep -q 'nothing that a pty lacks' report; } || die "a named port: exit $status: $(cat report said)"
# shellcheck disable=SC2016
try "$PORTTAPE" probe -- bash -c 'kill -9 $$' >report 2>said </dev/null
[[ $status == 137 ]] || die "after a signal: exit $status"
try "$PORTTAPE" probe -- ./gone >report 2>said </dev/null
[[ $status == 2 && ! -s report ]] || die "no such command: exit $status: $(cat report said)"
say "its ends are the command's"

# One supervisor is all that the kernel has: what is inside of another is not run.
try "$PORTTAPE" probe -- "$PORTTAPE" probe -- touch ran >report 2>said </dev/null
{ [[ $status == 1 && ! -e ran ]] && grep -q 'the command did not run' said; } || die "forbidden: exit $status: $(cat report said)"
say "where calls cannot be looked at the command is not run"

# A setuid program loses its owner's rights under a supervisor, which is told once.
if [[ $EUID == 0 ]] && command -v setpriv >/dev/null; then
  unprivileged() { setpriv --reuid 65534 --regid 65534 --clear-groups -- "$@"; }
  cp "$(type -P true)" owned
  chmod 4755 owned
  chmod a+rx "$work"
  try unprivileged "$PORTTAPE" probe -- "$work/owned" >report 2>said </dev/null
  { [[ $status == 0 ]] && grep -c "owned' is setuid 'root'.*run porttape as 'root'" said | grep -qx 1; } ||
    die "setuid: exit $status: $(cat report said)"
  try "$PORTTAPE" probe -- "$work/owned" >report 2>said </dev/null
  { [[ $status == 0 ]] && ! grep -q setuid said; } || die "setuid, as root: exit $status: $(cat report said)"
  say "a setuid program's lost rights are told"
fi
