#!/bin/bash
# gammu.sh PORT: gammu asks a phone who it is, and has it send a message.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
cat >"$work/gammurc" <<END_OF_CONFIGURATION
[gammu]
device = $port
connection = at115200
logfile = $work/log
logformat = textalldate
END_OF_CONFIGURATION
timeout 120 gammu -c "$work/gammurc" identify >"$work/said" 2>&1 || die "gammu identify gave $?: $(cat "$work/said"; tail -n 5 "$work/log")"
grep -q 'IMEI *: 490154203237518' "$work/said" || die "another phone: $(cat "$work/said")"
timeout 120 gammu -c "$work/gammurc" sendsms TEXT +49301234567 -text "The line behaves." >"$work/said" 2>&1 ||
  die "gammu sendsms gave $?: $(cat "$work/said"; tail -n 5 "$work/log")"
grep -q 'message reference=7' "$work/said" || die "no reference: $(cat "$work/said")"
say "identified, and a message sent"
