#!/bin/bash
# redact.sh: a recorded login redacted: its secret is nowhere, whatever blocks it stood in, the tape is sound and replays against
# a driver that knows the filler, the report tells of each place, memory is constant, and nothing is left of what fails.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
cd "$work"

# made STATUS COMMAND…: a verb, its exit status, what it says in out and err.
made() {
  local expected=$1
  try "$PORTTAPE" "${@:2}" >out 2>err
  [[ $status == "$expected" ]] || die "${*:2}: status $status: $(cat out err)"
}

line_pair line
# shellcheck disable=SC2016 # the shell of SYSTEM expands it
start socat "FILE:$work/line.far,raw,echo=0" 'SYSTEM:while read word; do echo "got $word"; done'
start "$PORTTAPED" record --device "serial:$work/line.near" --driver "pty:$work/port" --tape login 2>log
daemon=$started
wait_for port log
"$PYTHON" -c 'import sys, time
sys.path.insert(0, sys.argv[1])
from line import Line
line = Line(sys.argv[2])
for part in b"user ann", b"a\n", b"pass hunt", b"er2\n", b"serial 4711\n":
    line.write(part)
    time.sleep(0.02)
    if part.endswith(b"\n") and not line.read_until(b"\n", 60): sys.exit("no answer")' "$devices" "$work/port"
"$PORTTAPE" ctl -p "$daemon" mark "hunter2 was typed" >/dev/null
stop "$daemon"
cat >secrets.rules <<'END'
[[redact]]
name = 'password'
pattern = 'pass (\S+)'

[[redact]]
name = 'anywhere'
text = 'hunter2'

[[redact]]
name = 'none'
pattern = 'card \d{16}'
END

made 0 redact login --rules secrets.rules --dry-run
grep -q "w .*byte 15, 7 bytes: 'password'" out || die "the dry run does not show it: $(cat out)"
if compgen -G 'clean*' >/dev/null; then die "a dry run made $(echo clean*)"; fi
made 0 redact login --rules secrets.rules --identity --report report.json -o clean
grep -q "warning: secrets.rules:9: .*'none' is found nowhere" err || die "no warning: $(cat err)"
if grep -l hunter2 clean.log? report.json out err; then die "the secret is still there"; fi
made 0 verify clean
grep -q ': sound: ' out || die "$(cat out)"
"$PYTHON" - <<'END'
import json
import struct

def blocks(name):
    data, at, found = open(name, "rb").read(), 0, []
    while at < len(data):
        seconds, us, length = struct.unpack_from(">III", data, at)
        found.append((seconds, us, data[at + 12:at + 12 + length]))
        at += 12 + length
    return found

report = json.load(open("report.json"))
for side in "rw":
    before, after = blocks("login.log" + side), blocks("clean.log" + side)
    assert [(s, u, len(d)) for s, u, d in before] == [(s, u, len(d)) for s, u, d in after], side
    secret = b"".join(d for _, _, d in before)
    changed = bytearray(secret)
    filler = b"".join(d for _, _, d in after)
    for change in report["changes"]:
        if change["dir"] == side:
            begin, end = change["offset"], change["offset"] + change["length"]
            assert secret[begin:end] != filler[begin:end], change
            changed[begin:end] = filler[begin:end]
    assert changed == filler, f"the report does not tell all of {side}"
words = b"".join(d for _, _, d in blocks("clean.logw")).split()
assert words[:3] == [b"user", b"anna", b"pass"] and words[4:] == [b"serial", b"4711"], words
filler = words[3]
assert b"got pass " + filler in b"".join(d for _, _, d in blocks("clean.logr"))
headers = [json.loads(next(open(name, encoding="utf-8"))) for name in ("login.loge", "clean.loge")]
assert "host" in headers[0] and not {"host", "boot", "identity"} & {*headers[1], *headers[1]["zero"]}, headers
marks = [json.loads(line) for line in open("clean.loge") if '"mark"' in line]
assert [m["text"].encode() for m in marks] == [filler + b" was typed"], marks
assert {c["dir"] for c in report["changes"]} == {"r", "w", "e"}, report
open("filler", "wb").write(filler)
END
say "redact: the secret is nowhere, its filler everywhere; the report tells all"

# shellcheck disable=SC2016 # the shell of the test expands it
made 0 test --tape clean --timeout 30 -- bash -c 'ask "$1" "user anna" "pass $(cat filler)" "serial 4711"' driver '{port}'
say "the redacted tape replays"

cat >any.rules <<'END'
[[redact]]
name = 'digits'
pattern = '\d{2,}'
[[redact]]
name = 'words'
pattern = '(?i)[a-z]{4,}'
longest = 4096
[[redact]]
name = 'range'
dir = 'r'
offset = 3
size = 40
[[redact]]
name = 'bytes'
pattern = '[\x80-\xff]{2}'
END
tapes=("$e2e"/../../sample-logs/*.logr)
recordings=$e2e/../../../shared/recordings
if [[ -d $recordings ]]; then tapes+=("$recordings"/*.logr); else say "without the recordings of ../shared, which are not here"; fi
mkdir any
for tape in "${tapes[@]}"; do
  made 0 redact "${tape%r}" --rules any.rules --report any/report.json -o any/tape --overwrite
  made 0 verify any/tape
  "$PYTHON" - "$devices" "${tape%r}" <<'END' || die "$tape: the report does not tell what has changed"
import json, os, struct, sys
sys.path.insert(0, sys.argv[1])
import tapefile

def blocks(path):
    found = tapefile.blocks(path)
    if found or not os.path.getsize(path): return found
    data, at = open(path, "rb").read(), 0  # the native layout
    while at + 24 <= len(data):
        seconds, us, length = struct.unpack_from("<QQQ", data, at)
        found.append((seconds * 1_000_000 + us, data[at + 24:at + 24 + length]))
        at += 24 + length
    return found

def events(path):
    if not os.path.exists(path): return []
    lines = [json.loads(line) for line in open(path, encoding="utf-8")][1:]
    return [(line["event"], line["t_us"]) for line in lines if line["event"] != "end"]

changes = json.load(open("any/report.json"))["changes"]
for side in "rw":
    before, after = blocks(sys.argv[2] + side), blocks("any/tape.log" + side)
    assert [(at, len(data)) for at, data in before] == [(at, len(data)) for at, data in after], side
    expected, filled = (bytearray(b"".join(data for _, data in each)) for each in (before, after))
    for change in changes:
        part = slice(change["offset"], change["offset"] + change["length"])
        if change["dir"] == side: expected[part] = filled[part]
    assert expected == filled, side
before = events(sys.argv[2] + "e")
assert not before or before == events("any/tape.loge")
END
done
say "${#tapes[@]} recorded tapes: nothing changes but what the report tells"

"$PYTHON" - <<'END'
import struct
data = (b"$GPGLL,5057.970,N,00146.110,E,142451,A*27\r\n" + b"." * 980) * 4
for file in "rw":
    with open("big.log" + file, "wb") as out:
        for i in range(20000):
            out.write(struct.pack(">III", i // 100, i % 100 * 10000, 4096) + data[i % 1000:][:4096].ljust(4096, b"-"))
END
cat >big.rules <<'END'
[[frame]]
protocol = 'nmea'
[[redact]]
name = 'latitude'
column = 1
[[redact]]
name = 'time'
pattern = ',E,(\d+)'
END
if [[ -z ${SANITIZE:-} || ${SANITIZE:-} == OFF ]]; then most 65536 "$PORTTAPE" redact big --rules big.rules -o big.clean; fi
try bash -c 'trap "" XFSZ; ulimit -f 20000; exec "$@"' full "$PORTTAPE" redact big --rules big.rules -o full >out 2>err
[[ $status == 1 ]] || die "on a full disk: status $status: $(cat out err)"
grep -q 'full.*: File too large' err || die "the full disk is not told: $(cat err)"
start "$PORTTAPE" redact big --rules big.rules -o killed >/dev/null
kill -KILL "$started" 2>/dev/null || true
status_of "$started"
printf '[[redact]]\nname = "all"\npattern = "(?s).+"\nlongest = 16\n' >all.rules
made 2 redact login --rules all.rules -o full
grep -q "may go on beyond 16 bytes" err || die "what is too long is not told: $(cat err)"
for name in full killed; do
  if compgen -G "$name*" >/dev/null; then die "something is left: $(ls)"; fi
done
say "constant memory; nothing is left of what fails"
