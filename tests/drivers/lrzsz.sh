#!/bin/bash
# lrzsz.sh PORT sz|rz: lrzsz's sz sends up.bin, or its rz gets down.bin; both lie in $DRIVER_FOLDER.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
cd "$work"
case $1 in
  sz) command=(sz -b -q "$DRIVER_FOLDER/up.bin") ;;
  rz) command=(rz -b -y -q) ;;
  *) die "sz or rz, not $1" ;;
esac
(stty 115200 && exec timeout 120 "${command[@]}") <>"$port" >&0 2>err || die "$1 gave $?: $(cat err)"
[[ $1 == sz ]] || cmp "$DRIVER_FOLDER/down.bin" down.bin || die "another file than was sent"
say "the whole file"
