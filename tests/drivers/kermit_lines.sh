#!/bin/bash
# kermit_lines.sh PORT: C-Kermit watches the carrier, and waits for the signals of the line.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
cat >"$work/commands" <<END_OF_COMMANDS
set modem type none
set carrier-watch on
set line $port
if fail exit 1 cannot open the line
set speed 9600
show communications
wait 10 \\cd \\dsr \\cts
if fail exit 2 no signals
exit 0
END_OF_COMMANDS
timeout 120 kermit "$work/commands" -Y </dev/null >"$work/said" 2>&1 || die "kermit gave $?: $(tail -n 5 "$work/said")"
grep -E '\): *(On|Off)' "$work/said" | outcome
! grep -q 'signals unavailable' "$work/said" || die "signals unavailable: $(cat "$work/said")"
for line in CD DSR CTS; do
  grep -qE "\\($line\\): *On" "$work/said" || die "no $line: $(cat "$work/said")"
done
