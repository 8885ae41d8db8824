#!/bin/bash
# driver: pyserial's miniterm on a console of its own;  device: GNU bc behind socat. Somebody types three sums.
# shellcheck source=scenario.sh
source "$(dirname "$0")/../scenario.sh"
need bc socat
"$PYTHON" -c 'import serial' 2>/dev/null || die "no python3-serial; ./check installs it"
device socat "FILE:$device,raw,echo=0" EXEC:"bc -lq" 2>/dev/null
mkfifo "$work/keys"
exec 4<>"$work/keys"
input=$work/keys start socat - EXEC:"$PYTHON -m serial.tools.miniterm --raw --eol LF $driver 115200",pty,setsid,ctty,stderr \
  >"$work/screen" 2>"$work/err"
terminal=$started
on_screen() { tr -d '\r' <"$work/screen" | grep -aq "$1"; }
sees() { until_true on_screen "$1" || die "no '$1' on the screen: $(tail -c 300 "$work/screen") $(cat "$work/err")"; }
types() { printf '%b' "$1" >&4; }

sees 'Quit: '
# It prints that before it has set its terminal up.
is_set_up() { stty -a -F "$(readlink "/proc/$(pgrep -P "$terminal")/fd/0")" | grep -q -- -icanon; }
until_true is_set_up || die "miniterm does not set its terminal up: $(cat "$work/err")"
types '6*7\n'
sees '^42$'
types '2^100\n'
sees '^1267650600228229401496703205376$'
types 'scale=60;4*a(1)\n'
sees '3.14159265358979323846'
types '\035' # Ctrl-]
ended "$terminal" || die "miniterm did not quit"
say "ok: three sums"
