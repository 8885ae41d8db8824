#!/bin/bash
# avrdude.sh PORT: avrdude writes program.hex of $DRIVER_FOLDER into an Arduino by its bootloader, and reads it back.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
timeout 120 avrdude -c arduino -p atmega328p -P "$port" -b 115200 -D -U "flash:w:$DRIVER_FOLDER/program.hex:i" \
  >"$work/said" 2>&1 || die "avrdude gave $?: $(tail -n 5 "$work/said")"
grep -q 'bytes of flash verified' "$work/said" || die "not verified: $(cat "$work/said")"
say "written and verified"
