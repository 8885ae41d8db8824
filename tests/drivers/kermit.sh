#!/bin/bash
# kermit.sh PORT: C-Kermit hangs up (it sets no speed, B0, for a while), sends a file, takes another speed, and gets one.
# up.bin and down.bin lie in $DRIVER_FOLDER.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
export TZ=UTC # the files' times travel in local time
# Whatever adapts to the clock is off, so that each run gives the same bytes.
cat >"$work/commands" <<END_OF_COMMANDS
set modem type none
set carrier-watch off
set line $port
if fail exit 1 cannot open the line
set speed 38400
set flow-control none
set file type binary
set transfer display none
set transfer slow-start off
set streaming off
set window 1
set send timeout 120 fixed
set receive timeout 60
set receive packet-length 1000
hangup
set flow-control xon/xoff
cd $DRIVER_FOLDER
send up.bin
if fail exit 2 send failed
set speed 57600
set flow-control none
cd $work
get /command down.bin {cat >down.bin}
if fail exit 3 get failed
finish
exit 0
END_OF_COMMANDS
timeout 120 kermit "$work/commands" -Y </dev/null >"$work/said" 2>&1 || die "kermit gave $?: $(tail -n 5 "$work/said")"
cmp "$DRIVER_FOLDER/down.bin" "$work/down.bin" || die "another file than was sent"
say "both files"
