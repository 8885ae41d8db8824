#!/bin/bash
# locks.sh: UUCP's lock files between this daemon and C-Kermit: each sees that the other has the device.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat kermit
[[ -w /var/lock ]] || skip "/var/lock is not writable"
cd "$work"
line_pair line
tty=$(readlink line.near)
lock=/var/lock/LCK..${tty##*/}
rm -f "$lock" # of a pty that is gone, which had this number

start "$PORTTAPED" bridge --device "serial:$work/line.near,uucplock,alwaysopen" --driver "pty:$work/port" 2>log
daemon=$started
wait_for port log
[[ $(tr -d ' ' <"$lock") == "$daemon" ]] || die "no lock of the daemon's: $(cat log)"
timeout 120 kermit -Y -C "set line $tty, exit" </dev/null >kermit.log 2>&1 || true
grep -q "$daemon" kermit.log || die "kermit does not see who has the device: $(cat kermit.log)"
stop "$daemon"
[[ ! -e $lock ]] || die "the lock is left behind"

start kermit -Y -C "set carrier-watch off, set line $tty, pause 60, exit"
kermit=$started
until_true test -s "$lock" || die "kermit makes no lock"
try "$PORTTAPED" bridge --device "serial:$work/line.near" --driver "pty:$work/port" 2>log
[[ $status == 6 ]] || die "a device that kermit has: status $status: $(cat log)"
grep -q "busy: process $kermit ('kermit')" log || die "who has it is not told: $(cat log)"
kill -KILL "$kermit" # its lock stays, and counts no more
status_of "$kermit"
start "$PORTTAPED" bridge --device "serial:$work/line.near,uucplock,alwaysopen" --driver "pty:$work/port" 2>log
daemon=$started
wait_for port log
[[ $(tr -d ' ' <"$lock") == "$daemon" ]] || die "the lock of a dead process is not replaced: $(cat log)"
say "C-Kermit and the daemon see each other's locks, and not those of the dead"
