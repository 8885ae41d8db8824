#!/bin/bash
# pack.sh: tapes packed and unpacked are the same files; tar opens a pack; facts go in only as agreed; hostile archives give an
# error, and nothing inside or outside of the folder; nothing is left of what fails.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
cd "$work"

# made STATUS COMMAND…: a verb, its exit status, what it says in out and err.
made() {
  local expected=$1
  try "$PORTTAPE" "${@:2}" >out 2>err </dev/null
  [[ $status == "$expected" ]] || die "${*:2}: status $status: $(cat out err)"
}
samples=$e2e/../../sample-logs
printf '[[redact]]\nname = "version"\npattern = "SCIP[-0-9.]+"\n' >r.rules
made 0 redact "$samples/scip.log" --rules r.rules --report report.json -o scip
cp "$samples/nmea.loge" "$samples/nmea.logr" "$samples/nmea.logw" .

for pack in bug.tar.zst bug.tgz; do
  made 0 pack scip nmea -o "$pack" --driver-version 'laserd 2' --command 'laserd -p /dev/ttyUSB0' --redaction report.json
  if grep -q kernel out; then die "facts went in without a word: $(cat out)"; fi
  made 0 unpack "$pack" -o "of.$pack"
  grep -q 'command: laserd -p /dev/ttyUSB0' out || die "the command line is not shown: $(cat out)"
  for file in scip.loge scip.logr scip.logw nmea.loge nmea.logr nmea.logw; do cmp "$file" "of.$pack/$file"; done
  cmp report.json "of.$pack/redaction.json"
  mkdir "tar.$pack"
  tar -C "tar.$pack" -xf "$pack" || die "tar does not open it"
  diff -r "of.$pack" "tar.$pack/bug" || die "tar finds something else"
  tar -tvf "$pack" | grep -qv ' 0/0 ' && die "somebody's name is in it"
  made 2 unpack "$pack" -o "of.$pack"
  made 2 pack scip -o "$pack"
done
made 0 pack scip -o facts.tgz --facts
grep -q 'kernel: ' out || die "the facts are not shown: $(cat out)"
say "packs come out as they went in; tar opens them"

# On a terminal it asks.
asked() { "$PYTHON" - "$1" "$PORTTAPE" <<'END'
import os, pty, sys
answer, tool = sys.argv[1:]
child, terminal = pty.fork()
if child == 0: os.execv(tool, [tool, "pack", "scip", "-o", "asked." + answer + ".tgz"])
seen = b""
while b"[y/N]" not in seen: seen += os.read(terminal, 1000)
assert b"kernel: " in seen, seen
os.write(terminal, answer.encode() + b"\n")
try:
    while os.read(terminal, 1000): pass
except OSError: pass
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
END
}
for answer in y n; do
  asked "$answer" || die "asked, answered $answer: status $?"
  tar -xzOf "asked.$answer.tgz" "asked.$answer/manifest.json" >manifest
  [[ $(grep -c '"kernel"' manifest) == $([[ $answer == y ]] && echo 1 || echo 0) ]] || die "answered $answer: $(cat manifest)"
done
say "facts go in when they were seen and agreed to"

mkdir outside hostile
"$PYTHON" - <<'END'
import gzip, io, json, os, tarfile

source = tarfile.open("bug.tgz")
good = [(m.name, source.extractfile(m).read()) for m in source]

def entry(name, data=b"", **keys):
    info = tarfile.TarInfo(name)
    info.size = len(data)
    for key, value in keys.items(): setattr(info, key, value)
    return info, data

def pack(name, entries, head=good, manifest=None, tail=b"", format=tarfile.PAX_FORMAT):
    raw = io.BytesIO()
    with tarfile.open(fileobj=raw, mode="w", format=format) as out:
        for path, data in head:
            if manifest and path.endswith("manifest.json"): data = manifest(data)
            out.addfile(entry(path, data)[0], io.BytesIO(data))
        for info, data in entries: out.addfile(info, io.BytesIO(data))
    with gzip.open(f"hostile/{name}.tgz", "wb") as out: out.write(raw.getvalue() + tail)

def listed(*names):
    def change(data):
        told = json.loads(data)
        told["files"] += [{"name": n, "size": 1, "xxh3": "0" * 16} for n in names]
        told["tapes"] += [{"name": n[:-1], "verdict": "sound"} for n in names if n.endswith(".logr")]
        return json.dumps(told).encode()
    return change

def sized(size):
    def change(data):
        told = json.loads(data)
        told["files"][0]["size"] = size
        return json.dumps(told).encode()
    return change

pack("good", [])
os.rename("hostile/good.tgz", "repacked.tgz")
for name, path in {"up": "bug/../../outside/x", "up2": "../outside/x", "absolute": os.getcwd() + "/outside/x", "deep": "bug/a/b",
                   "dot": "bug/.", "dots": "bug/..", "other_folder": "outside/x", "no_folder": "x", "newline": "bug/a\nb",
                   "backslash": "bug\\x", "empty": "bug/", "twice": "bug/scip.logr", "manifest_twice": "bug/manifest.json"}.items():
    pack(name, [entry(path, b"1")])
    pack(name + "_listed", [entry(path, b"1")], manifest=listed(path.split("/", 1)[-1]))
for name, kind in {"symlink": tarfile.SYMTYPE, "hardlink": tarfile.LNKTYPE, "fifo": tarfile.FIFOTYPE, "char": tarfile.CHRTYPE,
                   "block": tarfile.BLKTYPE, "folder": tarfile.DIRTYPE, "sparse": tarfile.GNUTYPE_SPARSE}.items():
    pack(name, [entry("bug/x.logr", type=kind, linkname="../../outside/x", devmajor=1, devminor=3)], manifest=listed("x.logr"))
# Files of no tape, and names that hide, that are options, or that a terminal obeys.
for name, path in {"extra": "Makefile", "other_tape": "x.logw", "hidden": ".envrc", "hidden_tape": ".x.logr", "option": "-x.logr",
                   "c1": "a\u009b2J.logr", "bidi": "a\u202er.logr", "line": "a\u2028b.logr"}.items():
    pack(name, [entry("bug/" + path, b"1")], manifest=listed(path))
pack("link_then_file", [entry("bug/x.logr", type=tarfile.SYMTYPE, linkname="../../outside"), entry("bug/x.logr/y", b"1")])
pack("first_is_link", [entry("bug/manifest.json", type=tarfile.SYMTYPE, linkname="/etc/passwd")], head=[])
pack("bomb_unlisted", [entry("bug/x.logr", b"\0" * (64 << 20))])
pack("bomb_listed_small", [entry("bug/x.logr", b"\0" * (64 << 20))], manifest=listed("x.logr"))
pack("bomb_behind", [], tail=b"\0" * (64 << 20))
pack("huge", [], manifest=sized(1 << 62))
pack("larger", [], manifest=sized(1 << 20))
pack("garbage_inside", [], tail=b"garbage")
pack("second_archive", [], tail=b"\0" * 512 + b"x" * 512)
pack("missing", [], head=good[:-1])
pack("no_manifest", [], head=good[1:])
pack("changed", [], head=good[:2] + [(good[2][0], b"x" + good[2][1][1:])] + good[3:])
pack("bad_manifest", [], manifest=lambda data: b"[]")
pack("old_manifest", [], manifest=lambda data: data.replace(b'"version":1', b'"version":2'))
pack("id", [], manifest=lambda data: data.replace(b'"id":"', b'"id":"0', 1))
pack("two_tapes", [], manifest=lambda data: json.dumps((lambda told: {**told, "tapes": told["tapes"] * 2})(json.loads(data))).encode())
pack("no_report", [], head=[each for each in good if "redaction" not in each[0]],
     manifest=lambda data: json.dumps((lambda told: {**told, "files": told["files"][:-1]})(json.loads(data))).encode())
pack("verdict", [], manifest=lambda data: data.replace(b'"unchecked"', b'"sound"'))
pack("gnu_names", [entry("bug/" + "a" * 300, b"1")], format=tarfile.GNU_FORMAT)
whole = open("bug.tgz", "rb").read()
for name, data in {"cut": whole[:-9], "half": whole[:len(whole) // 2], "trailing": whole + b"x", "again": whole + whole, "nothing": b"",
                   "text": b"no archive\n", "twice_packed": gzip.compress(whole), "plain_tar": gzip.decompress(whole)}.items():
    open(f"hostile/{name}.tgz", "wb").write(data)
END
made 0 unpack repacked.tgz -o repacked
files=0
for pack in hostile/*.tgz; do
  (ulimit -f 40960; exec "$PORTTAPE" unpack "$pack" -o none) >out 2>err && die "$pack is accepted: $(cat out)"
  [[ $(wc -l <err) == 1 && $(cat err) == "porttape unpack: "* ]] || die "$pack: $(cat out err)"
  [[ -z $(ls outside) ]] || die "$pack wrote $(ls outside)"
  if compgen -G 'none*' >/dev/null || compgen -G '.none*' >/dev/null; then die "$pack left $(ls -a)"; fi
  files=$((files + 1))
done
((files >= 60)) || die "only $files hostile packs"
say "$files hostile packs: told, and nothing is left"

head -c 80000000 /dev/urandom >noise
"$PYTHON" -c 'import struct
with open("big.logr", "wb") as out, open("noise", "rb") as noise:
    for i in range(20000): out.write(struct.pack(">III", i // 100, i % 100 * 10000, 4000) + noise.read(4000))
open("big.logw", "wb").close()'
rm noise
if [[ -z ${SANITIZE:-} || ${SANITIZE:-} == OFF ]]; then
  most 65536 "$PORTTAPE" pack big -o big.tar.zst
  most 65536 "$PORTTAPE" unpack big.tar.zst -o big.out
  cmp big.logr big.out/big.logr
else
  made 0 pack big -o big.tar.zst
fi
try bash -c 'trap "" XFSZ; ulimit -f 20000; exec "$@"' full "$PORTTAPE" pack big -o full.tgz >out 2>err
[[ $status == 1 ]] || die "pack on a full disk: status $status: $(cat out err)"
grep -q 'full.tgz.*: File too large' err || die "the full disk is not told: $(cat err)"
try bash -c 'trap "" XFSZ; ulimit -f 20000; exec "$@"' full "$PORTTAPE" unpack big.tar.zst -o full >out 2>err
[[ $status == 1 ]] || die "unpack on a full disk: status $status: $(cat out err)"
grep -q 'full.*: File too large' err || die "the full disk is not told: $(cat err)"
made 2 unpack big.tar.zst -o full --max-size 79
grep -q -- '--max-size 81' err || die "what would do is not told: $(cat err)"
start "$PORTTAPE" pack big -o killed.tgz >/dev/null
kill -KILL "$started" 2>/dev/null || true
status_of "$started"
for name in full killed; do
  if compgen -G "$name*" >/dev/null || compgen -G ".$name*" >/dev/null; then die "something is left: $(ls -a)"; fi
done
say "constant memory; nothing is left of what fails"

# Archives need libarchive, which is loaded then: where it cannot be, that is told with what to install, and all else works.
mkdir without
: >without/libarchive.so.13
for verb in "pack scip -o without.tgz" "unpack bug.tgz -o without.folder" "convert scip.log -o without.sr"; do
  read -ra words <<<"$verb"
  LD_LIBRARY_PATH=$PWD/without made 1 "${words[@]}"
  grep -q 'libarchive13' err || die "$verb without libarchive: $(cat err)"
  if compgen -G "without.*" >/dev/null || compgen -G ".without*" >/dev/null; then die "$verb: something is left: $(ls -a)"; fi
done
LD_LIBRARY_PATH=$PWD/without made 0 info scip
say "without libarchive only archives are refused, in words"
