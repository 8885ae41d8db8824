#!/bin/bash
# errors.sh: wrong use and bad input. Each case must give its exit status and one clear line on stderr, and must leave the
# folder as it was: nothing overwritten, no half-made file, no link.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
mkdir "$work/d"
cd "$work/d"
failures=0 cases=0

"$PYTHON" - "$devices" <<'END'
import struct
def block(at, data, length=None):
    return struct.pack(">III", at // 1000000, at % 1000000, len(data) if length is None else length) + data
def tape(name, read, write):
    for end, data in (("r", read), ("w", write)):
        if data is not None:
            open(f"{name}.log{end}", "wb").write(data)
asked, answered = block(1000, b"ask\n"), block(2000, b"answer\n") + block(3000, b"more\n")
tape("good", answered, asked)
tape("empty", b"", b"")
tape("only_r", answered, None)
tape("only_w", None, asked)
tape("torn", answered + b"\0\0\0\1\0\0", asked)
tape("torn_data", answered + block(9000, b"half", 100), asked)
tape("micros", block(1000, b"ok") + struct.pack(">III", 0, 1000000, 1) + b"x" + answered, asked)
tape("back", block(5000000, b"ok") + answered, asked)
tape("text", b"This is a letter, not a tape.\n" * 40, b"Nor is this one.\n" * 40)
tape("elf", open("/bin/true", "rb").read(), asked)
for name in ("with space", "quo'te\"", "new\nline", "\u00e4\u20ac\U0001f4fc", "-dash", "per%cent{port}"):
    tape(name, answered, asked)
END
mkdir folder.logr folder full && touch full/file
echo "somebody's data" >file
ln -s file link_to_file
ln -s /dev/null foreign_link
line_pair line
near=serial:$work/line.near

state() { find . -printf '%p|%y|%s|%l\n' | sort; find . -type f -exec sha256sum {} + | sort; }
complain() {
  printf '%s: FAIL: %s\n  %s\n' "$self" "$*" "$(cat "$work/err")" >&2
  failures=$((failures + 1))
}
# case STATUS PATTERN COMMAND…: PATTERN is looked for in stderr, without regard to case.
case_() {
  local want=$1 pattern=$2 before lines
  shift 2
  cases=$((cases + 1))
  before=$(state)
  try timeout -k 5 120 "$@" </dev/null >"$work/out" 2>"$work/err"
  lines=$(grep -c . "$work/err" || true)
  [[ $status == "$want" ]] || complain "exit $status instead of $want: $(printf '%q ' "$@")"
  [[ $lines == 1 ]] || complain "$lines lines on stderr instead of 1: $(printf '%q ' "$@")"
  grep -qiE -- "$pattern" "$work/err" || complain "no /$pattern/ in the message: $(printf '%q ' "$@")"
  [[ $(state) == "$before" ]] || complain "left something behind: $(diff <(echo "$before") <(state)): $(printf '%q ' "$@")"
}
record() { case_ "$1" "$2" "$PORTTAPED" record "${@:3}"; }
replay() { case_ "$1" "$2" "$PORTTAPED" replay "${@:3}"; }
# A finding of verify is what it was asked for: it is on stdout.
finding() { case_ "$1" "$2" bash -c '"$@" >&2' verify "$PORTTAPE" verify "${@:3}"; }
tool() { case_ "$1" "$2" "$PORTTAPE" "${@:3}"; }
# works COMMAND…: must succeed.
works() {
  cases=$((cases + 1))
  try timeout -k 5 120 "$@" </dev/null >"$work/out" 2>"$work/err"
  [[ $status == 0 ]] || complain "exit $status instead of 0: $(printf '%q ' "$@")"
}

# Bad tapes.
for verb in verify info cat; do
  tool 2 'nothing' "$verb" nothing.log
  for tape in good only_r only_w torn torn_data empty; do works "$PORTTAPE" "$verb" "$tape"; done
done
for verb in info cat; do
  tool 2 'text.*not a .*tape' "$verb" text.log
  tool 2 'elf.*not a .*tape' "$verb" elf.log
  tool 2 'folder' "$verb" folder
done
finding 2 'text.*not a .*tape' text.log
finding 2 'elf.*not a .*tape' elf.log
finding 2 'folder' folder
finding 1 'micros.*14' micros.log
finding 1 'back.*back' back.log
tool 1 'micros.*14' cat micros.log
tool 1 'back.*back' cat back.log
replay 2 'nothing' --tape nothing --driver "pty:$work/d/port"
replay 2 'not a .*tape' --tape text.log --driver "pty:$work/d/port"
replay 2 'folder' --tape folder --driver "pty:$work/d/port"
tool 2 'nothing' test --tape nothing -- true '{port}'
tool 2 'not a .*tape' test --tape text.log -- true '{port}'

# Names that shells and parsers trip over.
for name in "with space" "quo'te\"" $'new\nline' 'ä€📼' "per%cent{port}"; do
  works "$PORTTAPE" verify "$name.log"
  works "$PORTTAPE" cat "$name"
done
works "$PORTTAPE" cat -- -dash.log
works "$PORTTAPE" cat ./-dash

# Wrong use.
case_ 2 'verb|usage|record' "$PORTTAPED"
case_ 2 'verb|usage|info' "$PORTTAPE"
case_ 2 'nonsense' "$PORTTAPED" nonsense
case_ 2 'nonsense' "$PORTTAPE" nonsense
record 2 'nonsense' --nonsense --device "$near" --driver "pty:$work/d/port" --tape new
record 2 'tape' --device "$near" --driver "pty:$work/d/port"
record 2 'device' --driver "pty:$work/d/port" --tape new
record 2 'driver' --device "$near" --tape new
free_ports unused
# shellcheck disable=SC2154 # free_ports sets it
tcp=tcp:127.0.0.1:$unused
record 2 'port.*70000' --device tcp:127.0.0.1:70000 --driver "pty:$work/d/port" --tape new
record 2 "port.*'0'" --device tcp:127.0.0.1:0 --driver "pty:$work/d/port" --tape new
record 2 'path.*missing' --device unix --driver "pty:$work/d/port" --tape new
record 6 'no/such.*No such file' --device unix:/no/such --driver "pty:$work/d/port" --tape new
record 2 'cannot listen.*192.0.2.1' --device "$tcp" --driver tcp-listen:192.0.2.1:2112 --tape new
record 2 'no-such.invalid.*resolve' --device "$tcp" --driver tcp-listen:no-such.invalid:2112 --tape new
record 2 'file.*not a socket' --device "$tcp" --driver "unix-listen:$work/d/file" --tape new
record 2 "IPv6" --device tcp:::1:2112 --driver "pty:$work/d/port" --tape new
record 2 'baud.*fast' --device "$near,baud=fast" --driver "pty:$work/d/port" --tape new
record 2 'baud' --device "$near,baud=-9600" --driver "pty:$work/d/port" --tape new
record 2 'parity.*maybe' --device "$near,parity=maybe" --driver "pty:$work/d/port" --tape new
record 2 'colour' --device "$near,colour=red" --driver "pty:$work/d/port" --tape new
record 2 'carrier' --device "carrier:$near" --driver "pty:$work/d/port" --tape new
replay 2 'strictness.*3' --tape good --driver "pty:$work/d/port" --strictness 3
replay 2 'jitter.*soon' --tape good --driver "pty:$work/d/port" --jitter soon
replay 2 'jitter.*-1' --tape good --driver "pty:$work/d/port" --jitter -1
replay 2 'rate.*0' --tape good --driver "pty:$work/d/port" --rate 0
replay 2 'timing.*sometimes' --tape good --driver "pty:$work/d/port" --timing sometimes
replay 2 'none' --tape good --driver "pty:$work/d/port" --timing none --strictness 2
replay 2 'log-level.*loud' --tape good --driver "pty:$work/d/port" --log-level loud
tool 2 'command' test --tape good

# Tapes and links that are in the way.
record 2 'good.log.*overwrite' --device "$near" --driver "pty:$work/d/port" --tape good
record 2 'missing' --device "$near" --driver "pty:$work/d/port" --tape missing/new
record 2 'file' --device "$near" --driver "pty:$work/d/port" --tape file/new
record 2 'file' --device "$near" --driver "pty:$work/d/file" --tape new
record 2 'link_to_file' --device "$near" --driver "pty:$work/d/link_to_file" --tape new
record 2 'foreign_link' --device "$near" --driver "pty:$work/d/foreign_link" --tape new
record 2 'full' --device "$near" --driver "pty:$work/d/full" --tape new
record 2 'missing' --device "$near" --driver "pty:$work/d/missing/port" --tape new
replay 2 'file' --tape good --driver "pty:$work/d/file"

# Devices.
record 6 'no_device' --device "serial:$work/no_device" --driver "pty:$work/d/port" --tape new
record 6 'folder' --device "serial:$work/d/folder" --driver "pty:$work/d/port" --tape new
record 6 'file' --device "serial:$work/d/file" --driver "pty:$work/d/port" --tape new
record 6 'null' --device serial:/dev/null --driver "pty:$work/d/port" --tape new

[[ $failures == 0 ]] || die "$failures complaints in $cases cases"
say "$cases cases"
