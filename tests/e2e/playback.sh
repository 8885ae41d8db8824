#!/bin/bash
# playback.sh: a replay as its users steer it: start paused, step, seek, pause, resume, rate by `porttape ctl`, parts of a tape and
# loops, and what status and the report tell of it.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
cd "$work"
own() { "$PORTTAPE" "$@" >out 2>err; }
fails() { # STATUS WORDS ARGUMENT…
  try own "${@:3}"
  [[ $status == "$1" ]] || die "porttape ${*:3} gives $status: $(cat out err)"
  grep -qF -- "$2" err || die "porttape ${*:3} does not say '$2': $(cat err)"
}
has_lines() { [[ $(wc -l <got) == "$1" ]]; }
ends_with() { [[ $(tail -n 1 got) == "$1" ]]; }
stands_at() { own status && grep -q "paused at $1 s" out; }
# A line each tenth of a second for twenty seconds, and a question and its answer at the end.
python3 - <<'END'
import struct
def blocks(name, items):
    with open(name, "wb") as tape:
        for us, data in items:
            tape.write(struct.pack(">III", us // 1000000, us % 1000000, len(data)) + data)
blocks("stream.logr", [(n * 100000, b"line %03d\n" % n) for n in range(200)])
blocks("stream.logw", [])
blocks("asks.logr", [(n * 100000 + 50000, b"answer %d\n" % n) for n in range(5)])
blocks("asks.logw", [(n * 100000, b"question %d\n" % n) for n in range(5)])
END

# Paused at first; a step of what is not asked for is a second of it; then it goes on from where a seek went.
start "$PORTTAPED" replay --tape stream --driver "pty:$work/port" --start 1 --end 15 --start-paused --report report 2>log
replay=$started
wait_for "$work/port" log
until_true test -S "control/$replay.sock"
fails 1 "no driver has the port open" ctl step
fails 1 "no driver has the port open" ctl seek 3
start cat "$work/port" >got
reader=$started
until_true stands_at 1.000 || die "it does not begin paused: $(cat out err)"
[[ ! -s got ]] || die "something came though it is paused: $(cat got)"
own ctl step || die "step: $(cat err)"
until_true has_lines 10 || die "a step is not a second: $(cat got)"
own ctl seek 14.75 || die "seek: $(cat err)"
[[ $(wc -l <got) == 10 ]] || die "a seek while it is paused plays: $(cat got)"
fails 1 "accepted: 1 to 15 s" ctl seek 99
fails 2 "accepted: a number, 0.000001 to 1000000" ctl rate 0
own ctl rate 0.5 || die "rate: $(cat err)"
own ctl resume || die "resume: $(cat err)"
until_true ends_with "line 149" || die "it does not go on from there: $(cat got)"
[[ $(sed -n 11p got) == "line 148" ]] || die "it does not go on at 14.75 s: $(cat got)"
fails 1 "it is not paused" ctl step
own ctl pause || die "pause: $(cat err)"
own status --json || die "status --json: $(cat err)"
[[ $(cat out) == *'"playback":{"paused":true'*'"rate":5E-1'* || $(cat out) == *'"playback":{"paused":true'*'"rate":0.5'* ]] ||
  die "status does not tell of it: $(cat out)"
stop "$reader"
own ctl stop || die "stop: $(cat err)"
[[ $(json report playback) == *"'steps': 1"*"'seeks': 1"*"'rates': 1"* || $(json report playback) == *'"steps": 1'*'"seeks": 1'*'"rates": 1'* ]] ||
  die "the report does not say what was done: $(cat report)"
grep -q "by hand .*paused 2 times" log || die "the log does not: $(cat log)"
say "paused, stepped, sought, resumed and slowed down"

# Three loops are one run, under a test as under a daemon.
cat >driver.py <<'END'
import os, sys
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
for loop in range(int(sys.argv[2])):
    for n in range(5):
        os.write(port, b"question %d\n" % n)
        answer = b""
        while not answer.endswith(b"\n"):
            answer += os.read(port, 100)
        assert answer == b"answer %d\n" % n, answer
END
own test --tape asks --loops 3 --report report -- python3 driver.py '{port}' 3 || die "three loops: $(cat out err)"
[[ $(json report playback) == *'loops_complete'*3* ]] || die "the report does not count loops: $(cat report)"
fails_with() { # STATUS ARGUMENT…
  try own "${@:2}"
  [[ $status == "$1" ]] || die "porttape ${*:2} gives $status: $(cat out err)"
}
fails_with 5 test --tape asks --loops 3 -- python3 driver.py '{port}' 2
own test --tape asks --at-end loop -- python3 driver.py '{port}' 4 || die "loops for ever: $(cat out err)"
fails_with 3 test --tape asks --loops 2 -- python3 driver.py '{port}' 3
say "loops"
