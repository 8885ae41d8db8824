#!/bin/bash
# soak.sh [EXCHANGES]: `porttape soak` finds a bug of a driver in how it meets faults, and `porttape shrink` makes of a
# session of many exchanges (default 500) one of at most 5. What both print to be typed does what it says.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need "$PYTHON"
count=${1:-500}
meter=$DEVICE_BIN/retry_meter
[[ -x $meter ]] || die "no $meter"
PATH=$(dirname "$PORTTAPE"):$PATH
cd "$work"

"$PYTHON" - "$count" <<'END'
import struct, sys
at = 0
with open("meter.logr", "wb") as read, open("meter.logw", "wb") as write:
    def put(file, text):
        global at
        at += 500
        file.write(struct.pack(">III", at // 1000000, at % 1000000, len(text)) + text.encode())
    for n in range(1, int(sys.argv[1]) + 1):
        body, check = f"{n:04d} {n * 37 % 100000:05d}", 0
        for each in body:
            check ^= ord(each)
        put(write, f"?{n:04d}\n")
        put(read, f"!{body}*{check:02X}\n")
END
try porttape verify meter
[[ $status == 0 ]] || die "the tape is not sound"

# what VERB: the line that it printed to be typed.
what() { sed -n "s/^  $1  *//p" out; }
# exchanges TAPE
exchanges() { porttape info --json "$1" | "$PYTHON" -c 'import json, sys; print(json.load(sys.stdin)["exchanges"])'; }

# hunt BUG STATUS OPTION…: it is found, repeated, and made small.
hunt() {
  local bug=$1 wanted=$2 begin=$SECONDS soaked left again
  shift 2
  try porttape soak --tape meter --seeds 1..1000 "$@" -- "$meter" '{port}' "$count" "$bug" >out
  [[ $status == 3 ]] || die "soak found nothing in $bug: status $status: $(cat out)"
  soaked=$((SECONDS - begin))
  cat out
  again=$(what repeat)
  try bash -c "$again" >said 2>&1
  grep -q "$wanted" said || die "the line that repeats it does not: $again: $(cat said)"
  try bash -c "$(what shrink)" >out
  [[ $status == 0 ]] || die "shrink: status $status: $(cat out)"
  cat out
  left=$(exchanges meter.small)
  ((left <= 5)) || die "$left exchanges are left of $count"
  try bash -c "$(what repeat)" >said 2>&1
  grep -q "$wanted" said || die "the small tape does not fail so: $(cat said)"
  say "$bug: found in $soaked s, and $count exchanges made $left in $((SECONDS - begin - soaked)) s"
  try bash -c "$(what repeat)" >said 2>&1
  try porttape shrink --tape meter --faults drop:p=0.001 -o meter.small -- true 2>said
  [[ $status == 2 ]] || die "shrink takes the name of a tape that is there: $(cat said)"
  rm meter.small*
}

try porttape soak --tape meter --seeds 1..10 -- "$meter" '{port}' "$count" good >out
[[ $status == 0 ]] || die "a driver that comes through all faults is blamed: $(cat out)"
hunt parser 'SIGABRT'
hunt twice 'wrong: request'
