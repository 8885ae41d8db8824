#!/bin/bash
# stm32flash.sh PORT: stm32flash reads a part of a chip's flash; flash.bin in $DRIVER_FOLDER is the same part.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
timeout 120 stm32flash -b 57600 -S "0x08000000:$(stat -c %s "$DRIVER_FOLDER/flash.bin")" -r "$work/read.bin" "$port" \
  >"$work/said" 2>"$work/log" || die "stm32flash gave $?: $(tr "\n" " " <"$work/log")"
grep -aE '^(Interface|Version|Device ID)' "$work/said" | outcome
grep -aq 'serial_posix: 57600 8E1' "$work/said" || die "another mode than 57600 8E1: $(cat "$work/said")"
grep -aq 'Device ID *: 0x0410' "$work/said" || die "another chip: $(cat "$work/said")"
cmp "$DRIVER_FOLDER/flash.bin" "$work/read.bin" || die "other bytes than the chip's"
