#!/bin/bash
# unit_restrictions.sh BUILD-FOLDER RESTRICTED: TCP, pty and Unix channels under the restrictions of the unit, by systemd
# where it runs, else by RESTRICTED with the unit's address families: they work, and a driver's close is seen at once.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
cd "$work"
chmod 755 "$work"
unit=$1/systemd/porttaped@.service
restricted=$2
[[ -f $unit ]] || die "no unit at $unit"
mkdir -m 777 links tapes
cp "$PORTTAPED" porttaped
# A device that knows no half-close: only the kernel can say that a driver has closed.
free_ports port device
start socat "UDP4-RECVFROM:$device,bind=127.0.0.1,fork" PIPE
wait_listening "$device"
# shellcheck disable=SC2154 # free_ports sets it
tcp=127.0.0.1:$port
device=udp:127.0.0.1:$device,recv_ip=127.0.0.1,recv_port=0
cat >channels.conf <<END
[channel tcp]
device = $device
driver = tcp-listen:$tcp
tape = $work/tapes/tcp
[channel pty]
device = $device
driver = pty:$work/links/pty,mode=0666
tape = $work/tapes/pty
[channel unix]
device = $device
driver = unix-listen:$work/links/unix,mode=0666
tape = $work/tapes/unix
END
chmod 644 channels.conf

# The unit's restrictions that need no folders of its own.
mapfile -t settings < <(grep -E '^(NoNewPrivileges|CapabilityBoundingSet|Protect|Restrict(Namespaces|Realtime|SUIDSGID|Address)|LockPersonality|MemoryDeny|SystemCall)' "$unit" | grep -v -E '^Protect(System|Home)')
if systemd-run --quiet --wait --collect true 2>/dev/null; then
  how=systemd-run
  properties=()
  for setting in "${settings[@]}"; do properties+=(-p "$setting"); done
  start systemd-run --quiet --wait --collect --pipe "${properties[@]}" -p User=nobody \
    "$work/porttaped" run channels.conf 2>log >addresses
else
  how=$(basename "$restricted")
  read -ra families < <(sed -n 's/^RestrictAddressFamilies=//p' "$unit")
  "$restricted" "${families[@]}" -- true || skip "there is neither systemd running nor seccomp here"
  start "$restricted" "${families[@]}" -- "$work/porttaped" run channels.conf 2>log >addresses
fi
daemon=$started
wait_for "$work/links/pty" log
wait_for "$work/links/unix" log
wait_listening "$port" log

"$PYTHON" - "$work" "$port" >slowest <<'END' || die "$(cat log)"
import os, socket, sys, termios, time, tty
work, port = sys.argv[1], int(sys.argv[2])
def closes(name):
    with open(work + "/log") as log:
        return sum(f" {name}: " in line and "the driver has closed it" in line for line in log)
def socket_to(family, address):
    line = socket.socket(family)
    line.settimeout(60)
    line.connect(address)
    return line.sendall, line.recv, line.close
def pty_at(path):
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
    return lambda data: os.write(fd, data), lambda size: os.read(fd, size), lambda: os.close(fd)
slowest = 0
for n in range(1, 4):
    for name, open_line in (
        ("tcp", lambda: socket_to(socket.AF_INET, ("127.0.0.1", port))),
        ("pty", lambda: pty_at(work + "/links/pty")),
        ("unix", lambda: socket_to(socket.AF_UNIX, work + "/links/unix")),
    ):
        write, read, close = open_line()
        write(b"hello")
        got = b""
        while len(got) < 5: got += read(5 - len(got))
        if got != b"hello": sys.exit(f"{name}: {got} for an answer")
        close()
        closed = time.monotonic()
        while closes(name) < n:
            if time.monotonic() - closed > 60: sys.exit(f"{name}: the close is not seen")
            time.sleep(0.005)
        slowest = max(slowest, time.monotonic() - closed)
print(round(1000 * slowest))
END
[[ $(<slowest) -le 1000 ]] || late "a close is seen after $(<slowest) ms: $(cat log)"
kill -TERM "$daemon"
ended "$daemon" || die "SIGTERM does not end it: $(cat log)"
status_of "$daemon"
[[ $status == 0 ]] || die "exit $status: $(cat log)"
for name in tcp pty unix; do
  [[ $(payload "tapes/$name.logr") == hellohellohello ]] || die "the tape of $name has $(payload "tapes/$name.logr")"
done
say "by $how: TCP, pty and Unix channels work, closes are seen after $(<slowest) ms at most"
