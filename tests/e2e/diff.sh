#!/bin/bash
# diff.sh: recorded tapes compared: the same driver and device twice, an answer that is another, one that is late; a page whole or
# not at all; large tapes in bounded memory.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
cd "$work"

# differs STATUS ARGUMENT…: porttape diff, its exit status, what it says in out and err.
differs() {
  local expected=$1
  try "$PORTTAPE" diff "${@:2}" >out 2>err
  [[ $status == "$expected" ]] || die "diff ${*:2}: status $status: $(cat out err)"
}
# asks FILE WORD…: a driver of the port in FILE.
cat >asks.py <<'PY'
import sys
sys.path.insert(0, sys.argv[1])
from line import Line
line = Line(sys.argv[2])
for word in sys.argv[3:]:
    line.write(word.encode() + b"\n")
    if not line.read_until(b"\n", 60).endswith(b"\n"): sys.exit("no answer to " + word)
PY
# tape NAME DEVICE WORD…: a tape of a driver that asks the words of what a shell's loop answers.
tape() {
  local name=$1 device=$2
  shift 2
  line_pair "line.$name"
  start socat "FILE:$work/line.$name.far,raw,echo=0" "SYSTEM:while read word; do $device; done"
  try "$PORTTAPE" record --device "serial:$work/line.$name.near,baud=19200" --tape "$name" -- \
    "$PYTHON" asks.py "$devices" '{port}' "$@" >out 2>err
  [[ $status == 0 ]] || die "record: status $status: $(cat out err)"
  stop "$started"
}

# shellcheck disable=SC2016 # the shell of SYSTEM expands them
{
  tape good 'echo got $word' one two three four
  tape again 'echo got $word' one two three four
  tape bad 'case $word in two) echo got tow;; *) echo got $word;; esac' one two four five
  tape late 'case $word in three) sleep 0.6;; esac; echo got $word' one two three four
}

# A busy machine may make any of them late.
differs 0 good again --margin off
grep -q '^same: good.log and again.log$' out || die "$(cat out)"
differs 3 good bad --margin off
grep -q '^different: 1 added, 1 missing, 1 changed$' out || die "$(cat out)"
grep -q '^changed  exchange 2 at .*: the answer from byte 5 on$' out || die "$(cat out)"
grep -q '"got tow\\n"  676f7420746f770a' out || die "$(cat out)"
differs 3 good late --margin 0.4
grep -q '^slower   exchange 3 at .*: the answer comes after ' out || die "$(cat out)"
differs 3 good bad --json --margin off
"$PYTHON" -c 'import json, sys
first, *rest = map(json.loads, open("out"))
assert not first["same"] and first["counts"] == {"added": 1, "missing": 1, "changed": 1, "moved": 0, "slower": 0, "faster": 0}, first
assert [each["kind"] for each in rest] == ["changed", "missing", "added"], rest' || die "$(cat out)"
say "recorded tapes: the same, changed, late"

differs 3 good bad --html page.html
"$PYTHON" -c 'import html.parser
class Page(html.parser.HTMLParser):
    void, open = ("meta",), []
    def handle_starttag(self, tag, attributes):
        assert tag not in ("script", "link", "img"), tag
        if tag not in self.void: self.open.append(tag)
    def handle_endtag(self, tag): assert self.open.pop() == tag
page = Page()
page.feed(open("page.html").read())
assert not page.open, page.open' || die "the page is none: $(cat page.html)"
differs 2 good bad --html page.html
cp page.html before.html
try bash -c 'trap "" XFSZ; ulimit -f 1; exec "$@"' full "$PORTTAPE" diff good bad --html page.html --overwrite >/dev/null 2>err
[[ $status == 1 ]] || die "a full disk: status $status: $(cat err)"
cmp page.html before.html || die "half a page"
differs 3 good bad --html page.html --overwrite
[[ $(echo .page* page*) == "page.html" || $(echo page*) == "page.html" ]] || die "something is left: $(ls -a)"
differs 3 good bad --html - --margin off
head -n 1 out | grep -q '^<!DOCTYPE html>$' || die "the page is not alone on stdout: $(head -n 3 out)"
say "the page: whole or not at all"

"$PYTHON" -c 'import struct
for name, odd in ("big", 0), ("other", 1):
    with open(name + ".logr", "wb") as read, open(name + ".logw", "wb") as write:
        for i in range(250000):
            if odd and i % 1000 == 7: continue
            answer = b"A%d\n" % (i ^ (odd and i % 1000 == 500))
            write.write(struct.pack(">III", i // 100, i % 100 * 10000, 2) + b"Q\n")
            read.write(struct.pack(">III", i // 100, i % 100 * 10000 + 5, len(answer)) + answer)'
differs 3 big other
grep -q '^different: 250 missing, 250 changed$' out || die "$(head out)"
if [[ -z ${SANITIZE:-} || ${SANITIZE:-} == OFF ]]; then
  "$PYTHON" -c 'import resource, subprocess, sys
subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL)
most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
if most > 131072: sys.exit(f"{most} KiB")' "$PORTTAPE" diff big other || die "too much memory"
fi
say "large tapes: exact, in bounded memory"
