#!/bin/bash
# replug.sh: a device is unplugged in mid-session and comes back under another name, found by a link whose folder was gone
# too. With alwaysopen the driver's line stays silent, without it is hung up; the tape says so, and its replay does the same.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
cd "$work"
link=$work/serial/by-id/usb-laser

# plug NAME: a device that answers each line, under another tty each time; unplug takes it and the folders away.
plug() {
  # shellcheck disable=SC2016 # the shell of SYSTEM expands it
  start socat "pty,raw,echo=0,link=$work/$1" SYSTEM:'while read -r word; do echo "got $word"; done' 2>socat.log
  device=$started
  wait_for "$1"
  mkdir -p serial/by-id
  ln -s "$(readlink "$1")" "$link"
}
# The links first: the kernel gives the name of the tty that goes to the next one, whoever makes it.
unplug() {
  rm -r serial
  stop "$device"
}

# driver.py LINK stays|reopens: asks, waits until the file `back` is there, asks again. What it saw goes to stdout.
cat >driver.py <<'END'
import os, sys, time
sys.path.insert(0, sys.argv[3])
from line import Line, LineClosed

def ask(line, word):
    line.write(word + b"\n")
    got = line.read_until(b"\n", 60)
    if got != b"got " + word + b"\n": sys.exit(f"{word}: got {got!r}")
    print(word.decode(), flush=True)

def until_back():
    while not os.path.exists("back"): time.sleep(0.01)

line = Line(sys.argv[1])
ask(line, b"one")
if sys.argv[2] == "stays":
    until_back()
else:
    try: sys.exit(f"no hang-up, but {line.read_until(b'end', 60)!r}")
    except LineClosed: print("hung up", flush=True)
    line.close()
    until_back()
    line = Line(sys.argv[1])
ask(line, b"two")
line.close()
END

# recorded KIND OPTION…: the driver on a device that is unplugged after its first answer.
recorded() {
  local kind=$1
  rm -f back saw
  plug "tty$kind.a"
  start "$PORTTAPED" record --device "serial:$link$2" --driver "pty:$work/port" --tape "$kind" 2>log
  daemon=$started
  wait_for port log
  start "$PYTHON" driver.py port "$kind" "$devices" >saw
  driver=$started
  until_true grep -q one saw || die "$kind: no answer: $(cat log)"
  unplug
  until_true grep -q 'is lost' log || die "$kind: the loss is not told: $(cat log)"
  [[ $kind == stays ]] || until_true grep -q 'hung up' saw || die "$kind: the driver's line is not hung up: $(cat log)"
  ! find "/proc/$daemon/fd" -lname '*pts/*(deleted)*' | grep -q . || die "$kind: the dead device is held"
  plug "tty$kind.b"
  touch back
  status_of "$driver"
  [[ $status == 0 ]] || die "$kind: the driver ends with $status: $(cat saw log)"
  unplug
  stop "$daemon"
}

# events_are KIND EVENT…: the events of its tape begin so, settings and flushes apart.
events_are() {
  local events
  events=$("$PYTHON" -c 'import json, sys
for line in open(sys.argv[1]):
    event = json.loads(line)
    if "event" in event: print(event["event"] + (":hung_up" if event.get("hung_up") else ""))' "$1.loge" |
    grep -vE 'settings|flush' | paste -sd' ')
  [[ $events == "$2"* ]] || die "$1: the events are $events"
}

recorded stays ,alwaysopen
[[ $(paste -sd' ' saw) == 'one two' ]] || die "the driver saw $(cat saw)"
events_are stays 'open device-lost device-back close'
grep -q 'is back' log || die "that it is back is not told: $(cat log)"
recorded reopens ''
[[ $(paste -sd' ' saw) == 'one hung up two' ]] || die "the driver saw $(cat saw)"
events_are reopens 'open device-lost:hung_up close open close'
for kind in stays reopens; do
  [[ $(payload "$kind.logr" | paste -sd' ') == 'got one got two' ]] || die "$kind: the tape has $(payload "$kind.logr")"
  try "$PORTTAPE" test --tape "$kind" --timeout 30 -- "$PYTHON" driver.py '{port}' "$kind" "$devices" >out 2>&1
  [[ $status == 0 ]] || die "$kind: the replay ends with $status: $(cat out)"
done
say "unplugged and back under another name: silent with alwaysopen, hung up without, replayed both"

# The daemon waits for a device whose folders are not there yet.
start "$PORTTAPED" bridge --device "serial:$link,wait" --driver "pty:$work/port" 2>log
daemon=$started
wait_for port log
touch back
start "$PYTHON" driver.py port stays "$devices" >saw
driver=$started
until_true grep -q 'a driver has opened it' log || die "the driver is not seen: $(cat log)"
plug tty.c
status_of "$driver"
[[ $status == 0 ]] || die "wait: the driver ends with $status: $(cat saw log)"
say "a device that was not there yet is found when its folders come"
