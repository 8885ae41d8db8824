#!/bin/bash
# sigrok.sh PORT: sigrok takes five readings of a multimeter.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
timeout 120 sigrok-cli --driver "uni-t-ut61e-ser:conn=$port" --samples 5 >"$work/found" 2>"$work/log" ||
  die "sigrok-cli gave $?: $(cat "$work/log")"
outcome <"$work/found"
printf 'P1: 1.234%d V DC AUTO\n' 1 2 3 4 5 | cmp - "$work/found" || die "other readings: $(cat "$work/found" "$work/log")"
