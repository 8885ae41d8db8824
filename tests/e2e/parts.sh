#!/bin/bash
# parts.sh: a recorded tape cut, split, merged and recovered: its parts replay, the merged one is the tape again, damage costs
# what it touches, and nothing is left behind by what fails or is killed.
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
# replays TAPE WORD…: the driver passes against it.
replays() {
  local tape=$1
  shift
  made 0 test --tape "$tape" --timeout 30 -- bash -c "ask {port} $*"
}
# same ONE OTHER: both tapes hold the same blocks.
same() { cmp "$1.logr" "$2.logr" && cmp "$1.logw" "$2.logw" || return; }
count() { "$PORTTAPE" info --json "$1" | "$PYTHON" -c 'import json, sys; print(json.load(sys.stdin)[sys.argv[1]])' "$2"; }

line_pair line
# shellcheck disable=SC2016 # the shell of SYSTEM expands it
start socat "FILE:$work/line.far,raw,echo=0" 'SYSTEM:while read word; do echo "got $word"; done'
start "$PORTTAPED" record --device "serial:$work/line.near,baud=19200" --driver "pty:$work/port" --tape whole 2>log
daemon=$started
wait_for port log
ask port one two
until_true closes log 1 || die "the first close is not seen: $(cat log)"
"$PORTTAPE" ctl -p "$daemon" mark begin >/dev/null
ask port three
until_true closes log 2 || die "the second close is not seen: $(cat log)"
"$PORTTAPE" ctl -p "$daemon" mark end >/dev/null
ask port four five
until_true closes log 3 || die "the third close is not seen: $(cat log)"
stop "$daemon"
made 0 verify whole

made 0 cut whole --exchange 2 -o second
replays second two
made 0 cut whole --mark begin..end --rebase -o between
replays between three
made 0 verify between
grep -q '"carried":true' second.loge || die "what held is not on the part: $(cat second.loge)"
grep -q '"baud":19200' between.loge || die "the device's settings are not on the part: $(cat between.loge)"
made 0 cut whole --from 0 -o all
same whole all || die "a cut of everything is not the tape"
made 2 cut whole --exchange 9 -o none
grep -q 'only 5 exchanges' err || die "it is not told how many there are: $(cat err)"
say "cut: parts replay"

made 0 split whole -o part
[[ $(grep -c 'part\.[123]\.log: ' out) == 3 ]] || die "not three sessions: $(cat out)"
replays part.1 one two
replays part.2 three
replays part.3 four five
made 0 merge part.3 part.1 part.2 -o again
made 0 verify again
grep -q ': sound: ' out || die "$(cat out)"
same whole again || die "the merged parts are not the tape"
# The header is another, and with it the digest of all lines.
events() { tail -n +2 "$1" | sed 's/,"events_xxh3":.*/}/'; }
diff <(events whole.loge) <(events again.loge) || die "the events of the merged parts are not the tape's"
made 0 merge second between -o two
replays between three
say "split and merge: the parts replay, and are the tape again"

made 0 recover whole -o sound
same whole sound || die "a sound tape is not itself"
for file in r w e; do cp "whole.log$file" "bad.log$file"; done
printf '\377\377\377\377\377\377\377\377' | dd of=bad.logr bs=1 seek=20 conv=notrunc 2>dd.log || die "$(cat dd.log)"
made 1 verify bad
made 1 cut bad --from 0 -o none
grep -q 'porttape recover TAPE' err || die "what to do is not told: $(cat err)"
made 1 split bad --every 0.000001 -o none
made 3 recover bad -o mended
grep -q 'lost  bad.logr at offset ' out || die "what is lost is not told: $(cat out)"
made 0 verify mended
(($(count mended exchanges) == 5)) || die "writes are lost"
cmp -s whole.logw mended.logw || die "a file without damage has become another"
rm bad.logw
made 3 recover bad -o mended --overwrite
grep -q 'bad.logw is missing' out || die "$(cat out)"
say "recover: damage costs what it touches"

"$PYTHON" -c 'import struct
for file in "rw":
    with open("big.log" + file, "wb") as out:
        for i in range(20000):
            out.write(struct.pack(">III", i // 100, i % 100 * 10000, 4096) + bytes([i & 255]) * 4096)'
if [[ -z ${SANITIZE:-} || ${SANITIZE:-} == OFF ]]; then
  most 65536 "$PORTTAPE" cut big --from 1 -o big.cut
  most 65536 "$PORTTAPE" split big --every 60 -o big
  most 65536 "$PORTTAPE" merge big.1 big.2 big.3 big.4 -o big.merged
  most 65536 "$PORTTAPE" recover big -o big.recovered
  for tape in big.recovered big.merged; do same big "$tape" || die "$tape is not the big tape"; done
  rm big.*.log?
fi
for line in "cut big --from 1" "split big --gap 1000" "merge big second" "recover big"; do
  read -ra verb <<<"$line"
  try bash -c 'trap "" XFSZ; ulimit -f 20000; exec "$@"' full "$PORTTAPE" "${verb[@]}" -o full >out 2>err
  [[ $status == 1 ]] || die "$line on a full disk: status $status: $(cat out err)"
  grep -q 'full.*: File too large' err || die "$line does not tell the full disk: $(cat err)"
  start "$PORTTAPE" "${verb[@]}" -o killed >/dev/null
  kill -KILL "$started" 2>/dev/null || true
  status_of "$started"
  if [[ $status != 0 ]] && compgen -G 'killed*' >/dev/null; then die "$line: killed, it has left $(echo killed*)"; fi
  rm -f killed*
done
for name in full none; do
  if compgen -G "$name*" >/dev/null; then die "something is left: $(ls)"; fi
done
say "constant memory; nothing is left of what fails"
