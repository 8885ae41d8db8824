#!/bin/bash
# bind.sh: a port that is bound on a file is a tty in a container that has a /dev/pts of its own, where a link leads nowhere; it
# moves with a hang-up, and what a killed daemon left is replaced. The container is a mount namespace that follows its host's.
if [[ -z ${IN_NAMESPACE:-} ]] && unshare -m true 2>/dev/null; then
  IN_NAMESPACE=1 exec unshare -m --propagation shared "$0" "$@"
fi
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
[[ -n ${IN_NAMESPACE:-} ]] || skip "nothing may be mounted here (needs root, CAP_SYS_ADMIN)"
need socat unshare
cd "$work"

cat >container.py <<'END'
import os, subprocess, sys, time

def wait(name):
    while not os.path.exists(name): time.sleep(0.01)

def ask():
    line = os.open("port", os.O_RDWR | os.O_NOCTTY)
    if not os.isatty(line): sys.exit("no tty")
    os.write(line, b"ask\n")
    got = b""
    while len(got) < 4: got += os.read(line, 4)
    if got != b"ask\n": sys.exit(f"got {got!r}")
    return line

wait("there")
subprocess.run(["mount", "-t", "devpts", "-o", "newinstance,ptmxmode=0666", "devpts", "/dev/pts"], check=True)
if os.path.exists("link"): sys.exit("the link leads somewhere")
line = ask()
open("asked", "w").close()
try:
    if os.read(line, 1): sys.exit("bytes from a device that is gone")
except OSError: pass
os.close(line)
wait("back")
os.close(ask())
END

plug() {
  start socat "pty,raw,echo=0,link=$work/dev" PIPE
  device=$started
  wait_for dev
}
announced() { [[ $(grep -c "$work/port is there" log) == "$1" ]]; }
serve() { # the how many-th daemon it is: one that is killed has told of its mount by then
  start "$PORTTAPED" bridge --device "serial:$work/dev" --driver "pty:$work/link,bind=$work/port" 2>>log
  daemon=$started
  until_true announced "$1" || die "no port, or what a killed daemon left is not replaced: $(cat log)"
  [[ -c port ]] || die "nothing is mounted: $(cat log)"
}

plug
start unshare -m --propagation slave "$PYTHON" container.py 2>container.log
container=$started
serve 1
kill -KILL "$daemon"
status_of "$daemon"
[[ -c port ]] || die "the mount has gone with the killed daemon"
serve 2
touch there
until_true test -e asked || die "no answer in the container: $(cat container.log log)"
stop "$device"
until_true grep -q 'hung up' log || die "the line is not hung up: $(cat log)"
plug
touch back
status_of "$container"
[[ $status == 0 ]] || die "in the container: $(cat container.log log)"
stop "$daemon"
[[ ! -e port && ! -L link ]] || die "the names are left behind: $(ls -l)"
! grep -q "$work" /proc/self/mountinfo || die "a mount is left: $(grep "$work" /proc/self/mountinfo)"
say "a port on a file: there in a container, moved by a hang-up, taken away at the end"

try "$PORTTAPED" bridge --device "serial:$work/dev" --driver "pty:,bind=$work/log" 2>err
[[ $status == 2 ]] || die "a file with data: status $status: $(cat err)"
grep -q 'not an empty file' err || die "a file with data: $(cat err)"
