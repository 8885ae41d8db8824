#!/bin/bash
# acceptance.sh TAPE: a recording of a laser scanner (TAPE.logr, TAPE.logw) against a driver that sends its requests again:
# byte-exact, and with each fault found for what it is. Environment: RUNS (2) at each strictness with all cores busy,
# JITTER in ms (400; wide, since a busy machine delays the driver too).
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
tape=${1%.log}
runs=${RUNS:-2} jitter=${JITTER:-400}
if [[ ! -e $tape.logr || ! -e $tape.logw ]]; then
  [[ $tape == "$SHARED_DIR"/* ]] || die "no recording $tape"
  skip "there is no recording $tape"
fi

report=$work/report.json
payload "$tape.logr" >"$work/expected.r"
payload "$tape.logw" >"$work/expected.w"
requested=$(stat -c %s "$work/expected.w")
client=("$devices/scip_client.py" '{port}' --script "$tape.logw" --expect "$tape.logr" --save "$work/got")

# against STRICTNESS CLIENT-OPTION…: one run under porttape test; sets $status.
against() {
  local strictness=$1
  shift
  rm -f "$report" "$work/got"
  try "$PORTTAPE" test --tape "$tape.log" --strictness "$strictness" --jitter "$jitter" --report "$report" --timeout 120 -- \
    "${client[@]}" "$@" >"$work/out" 2>&1
}
expect() { # STATUS VERDICT
  [[ $status == "$1" ]] || die "exit $status, expected $1: $(cat "$work/out")"
  verdict_is "$2" "$report"
  [[ $(json "$report" exit) == "$1" ]] || die "the report's exit is not $1: $(cat "$report")"
}
byte_exact() {
  cmp "$work/expected.r" "$work/got" || die "the driver received other bytes than recorded"
  [[ $(json "$report" from_driver.matched) == "$requested" ]] || die "not all requests matched: $(cat "$report")"
}

# In time at strictness 2: a busy machine may stop the driver for longer than JITTER. The verdict is right then, and the
# run is made again.
in_time() {
  local attempt
  for ((attempt = 0; attempt < 5; attempt++)); do
    against 2
    [[ $status == 4 && $(json "$report" mismatch.kind) == timing ]] || return 0
    say "the driver was late, and is tried again: $(json "$report" mismatch)"
  done
  late "the driver was late 5 times: $(cat "$work/out")"
}

keep_busy
for ((run = 0; run < runs; run++)); do
  against 1
  expect 0 pass
  byte_exact
  in_time
  expect 0 pass
  byte_exact
done
quiet
say "byte-exact, $runs runs at each of strictness 1 and 2, all cores busy"

offset=$((requested / 2))
byte_at() { od -An -tx1 -j "$1" -N 1 "$work/expected.w" | tr -d ' '; }
against 1 --change-byte "$offset"
expect 3 data-mismatch
[[ $(json "$report" mismatch.kind) == data && $(json "$report" mismatch.offset) == "$offset" ]] ||
  die "not at offset $offset: $(cat "$report")"
right=$(byte_at "$offset")
wrong=$(printf '%02x' $((16#$right ^ 1)))
[[ $(json "$report" mismatch.expected_hex) == "$right"* ]] || die "expected_hex does not begin with $right: $(cat "$report")"
[[ $(json "$report" mismatch.got_hex) == "$wrong"* ]] || die "got_hex does not begin with $wrong: $(cat "$report")"
say "byte $offset changed: found there"

late=$((2 * jitter))
against 2 --delay 4 "$late"
expect 4 timing-mismatch
[[ $(json "$report" mismatch.kind) == timing ]] || die "not a timing mismatch: $(cat "$report")"
[[ $(json "$report" mismatch.error_us) -gt $((jitter * 1000)) ]] || die "error_us is too small: $(cat "$report")"
against 1 --delay 4 "$late"
expect 0 pass
say "request 4 late by $late ms: found at strictness 2, no matter at 1"

against 1 --leave-out-last
expect 5 incomplete
[[ $(json "$report" from_driver.bytes) -lt $requested ]] || die "nothing is missing? $(cat "$report")"
say "last request left out: found"

rm -f "$report" "$work/got"
start "$PORTTAPED" replay --tape "$tape.log" --driver "pty:$work/port" --strictness 1 --once --report "$report" 2>"$work/log"
daemon=$started
wait_for "$work/port" "$work/log"
start "$devices/scip_client.py" "$work/port" "${client[@]:2}" --pause 100 --timeout 30 >"$work/out" 2>&1
driver=$started
until_true grep -q '^exchange 3:' "$work/out" || die "the driver does not get on: $(cat "$work/out" "$work/log")"
kill -STOP "$driver"
sleep 3
kill -CONT "$driver"
status_of "$driver"
[[ $status == 0 ]] || die "the stopped driver gave $status: $(cat "$work/out")"
ended "$daemon" || die "porttaped replay --once does not end after the run"
status_of "$daemon"
expect 0 pass
byte_exact
say "driver stopped for 3 s in mid-session: byte-exact, pass"
