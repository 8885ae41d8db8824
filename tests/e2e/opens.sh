#!/bin/bash
# opens.sh [COUNT]: so many opens and closes of the driver's port (500 unless said; 10000 take a quarter of a minute) in each of bridge,
# record and replay, with an exchange in each: the daemon holds no more descriptors, threads, watches and memory at the end
# than after the first tenth, and the last ones take no more processor time than the first. And of a port whose device is missing.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
count=${1:-500}
cd "$work"

cat >opens.py <<'END'
import os, sys, time

daemon, port, count, answers = int(sys.argv[1]), sys.argv[2], int(sys.argv[3]), sys.argv[4] == "answers"
pause = float(os.environ.get("PAUSE", "0"))  # seconds between two of them
tenth = max(count // 10, 1)

def spent():
    """Processor time of the daemon, all threads, in ns: its CPU clock, as clock_getcpuclockid(3) names it. What else the
    machine does tells little there."""
    return time.clock_gettime_ns(~daemon << 3 | 2)

def one():
    time.sleep(pause)
    begin = spent()
    line = os.open(port, os.O_RDWR | os.O_NOCTTY)
    try:
        if answers:
            os.write(line, b"ask\n")
            got = b""
            while len(got) < 4:
                part = os.read(line, 100)
                if not part: sys.exit("the line is dead")
                got += part
            if got != b"ask\n": sys.exit(f"got {got!r}")
        else:
            try:
                if os.read(line, 1): sys.exit("bytes from a device that is not there")
            except OSError: pass
    finally:
        os.close(line)
    return spent() - begin

def held():
    fds = os.listdir(f"/proc/{daemon}/fd")
    watches = 0
    for fd in fds:
        try: watches += open(f"/proc/{daemon}/fdinfo/{fd}").read().count("inotify wd")
        except OSError: pass
    status = dict(line.split(":", 1) for line in open(f"/proc/{daemon}/status"))
    return {"descriptors": len(fds), "watches": watches, "threads": int(status["Threads"]),
            "KiB": int(status["VmRSS"].split()[0])}

def least(looks):
    return {key: min(look[key] for look in looks) for key in looks[0]}

def settled(wanted=None):
    """What is held once the last close has been handled: the least of some looks; of more where it is not yet as `wanted`."""
    looks, end = [], time.monotonic() + 30
    while len(looks) < 20 or wanted and time.monotonic() < end and any(
            least(looks)[key] > wanted[key] for key in ("descriptors", "watches")):
        time.sleep(0.02)
        looks.append(held())
    return least(looks)

first = [one() for _ in range(tenth)]
before = settled()
rest = [one() for _ in range(count - tenth)]
after = settled(before)
def usual(times):
    return sorted(times)[len(times) // 2]

# Where the scheduler puts things doubles what is spent: the best of the last five tenths counts, and 200 us more are nothing.
# Opens that have become slow stay so, and get slower the more they are.
last = min(usual(rest[-(at + tenth):len(rest) - at]) for at in range(0, 5 * tenth, tenth))
ratio = last / usual(first)
print(f"{count} opens: {before} -> {after}")
if answers: print(f"the last tenths take {ratio:.2f} times the processor time of the first ({usual(first) / 1000:.0f} us)")
# A job that had to wait on a busy machine got a thread more.
for key, more in ("descriptors", 0), ("watches", 0), ("threads", 4):
    if after[key] > before[key] + more: sys.exit(f"{key}: {before[key]} after {tenth} opens, {after[key]} after {count}")
# A sanitizer keeps what was freed.
if after["KiB"] > before["KiB"] + 1024 and not os.environ.get("SANITIZE"): sys.exit(f"memory: {before['KiB']} KiB, then {after['KiB']} KiB")
if answers and ratio > 3 and last - usual(first) > 200000: sys.exit(f"the last tenths take {ratio:.1f} times the processor time of the first")
END

line_pair line
pair=$started
start socat "FILE:$work/line.far,raw,echo=0" PIPE

# run NAME COUNT WHAT COMMAND…: a daemon, and so many opens of its port.
run() {
  local name=$1 opens=$2 what=$3
  shift 3
  start "$@" --driver "pty:$work/port" --log-level warn 2>"$name.log"
  daemon=$started
  wait_for port "$name.log"
  "$PYTHON" opens.py "$daemon" port "$opens" "$what" >out 2>&1 || die "$name: $(cat out) $(tail -5 "$name.log")"
  say "$name: $(paste -sd' ' out)"
}

run bridge "$count" answers "$PORTTAPED" bridge --device "serial:$work/line.near"
stop "$daemon"
# Where one opens within microseconds of the other's close, two sessions may be one on the tape: then once more, with pauses.
for pause in 0 0.002 0.02; do
  tape=tape$pause
  PAUSE=$pause run record "$count" answers "$PORTTAPED" record --device "serial:$work/line.near" --tape "$tape"
  stop "$daemon"
  "$PORTTAPE" verify "$tape" >out || die "verify: $(cat out)"
  sessions=$("$PORTTAPE" info "$tape" | awk '$1 == "sessions" { print $2 }')
  ((sessions == count)) && break
  say "record: $sessions sessions on the tape"
done
((sessions == count)) || die "each time sessions are missing on the tape"
run replay "$count" answers "$PORTTAPED" replay --tape "$tape"
kill -TERM "$daemon"
status_of "$daemon"
[[ $status == 0 ]] || die "the replay of all sessions ends with $status: $(cat replay.log)"

# A driver that spins on a dead line: one line in the log, and a pace that keeps no processor busy.
start "$PORTTAPED" bridge --device "serial:$work/line.near" --driver "pty:$work/dead" 2>dead.log
daemon=$started
wait_for dead dead.log
stop "$pair"
"$PYTHON" opens.py "$daemon" dead 10 none >out 2>&1 || die "dead line: $(cat out dead.log)"
say "dead line: $(cat out)"
[[ $(grep -c 'is it plugged in' dead.log) == 1 ]] || die "the log does not tell once that the device is missing: $(cat dead.log)"
(($(wc -l <dead.log) < 10)) || die "the log is full of one trouble: $(cat dead.log)"
stop "$daemon"
grep -q 'more times in the same way' dead.log || die "the log does not tell how often: $(cat dead.log)"
