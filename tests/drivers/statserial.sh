#!/bin/bash
# statserial.sh PORT: the table of the line's signals.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
exec 3<>"$port"
timeout 120 statserial -n "$port" >"$work/said" 2>&1 || die "statserial gave $?: $(cat "$work/said")"
awk '$4 == "in" || $4 == "out" { print $1, $5 }' "$work/said" | outcome
for line in 'CTS .* 1 ' 'DSR .* 1 ' 'DCD .* 1 ' 'RI .* 0 '; do
  grep -q "^$line" "$work/said" || die "no line '$line': $(cat "$work/said")"
done
