#!/bin/bash
# test_ends.sh: `porttape test` ends a command that sleeps while nothing is due, and with --timeout 0 does not.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
tape=$e2e/../../sample-logs/scip
start "$PORTTAPE" test --tape "$tape" --timeout 0 -- bash -c 'exec 3<>{port}; sleep 1000' 2>"$work/never"
never=$started
begin=$SECONDS
try "$PORTTAPE" test --tape "$tape" -- bash -c 'exec 3<>{port}; sleep 1000' >/dev/null 2>"$work/said"
[[ $status == 5 ]] || die "status $status: $(cat "$work/said")"
((SECONDS - begin >= 9)) || die "ended after $((SECONDS - begin)) s"
grep -q 'nothing was due' "$work/said" || die "not told why: $(cat "$work/said")"
grep -q 'the tape goes on after a write' "$work/said" || die "not told what the tape waits for: $(cat "$work/said")"
alive "$never" || die "--timeout 0 was ended too: $(cat "$work/never")"
say "after $((SECONDS - begin)) s"
