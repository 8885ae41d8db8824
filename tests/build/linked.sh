#!/bin/bash
# linked.sh PROGRAM…: each needs the C library alone at its start; everything else is in it, or is loaded when it is needed.
set -euo pipefail
for program; do
  needed=$(readelf -d "$program" | sed -n 's/.*(NEEDED).*\[\(.*\)\]/\1/p')
  [[ -n $needed ]] || { echo "$program needs no library at all: readelf said nothing" >&2; exit 1; }
  while read -r library; do
    case $library in
      libc.so.* | libm.so.* | ld-linux*) ;;
      *) echo "$program needs $library at its start" >&2; exit 1 ;;
    esac
  done <<<"$needed"
done
