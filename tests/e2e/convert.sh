#!/bin/bash
# convert.sh: drivers recorded without porttape, by strace and by socat alone, replay from the converted tapes.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
PATH=$PATH:/usr/sbin
need strace socat mbpoll flashrom
[[ -x $DEVICE_BIN/serprog_flash ]] || die "serprog_flash is not built"
[[ -x $DEVICE_BIN/modbus_slave ]] || die "modbus_slave is not built; ./check installs libmodbus-dev"
cd "$work"

# mbpoll opens its port for each question; two of them under one strace.
line_pair modbus
start "$DEVICE_BIN/modbus_slave" modbus.far 19200
modbus=$started
until_true has_open "$modbus" modbus.far || die "the slave does not open its line"
mbpolls=$(command -v mbpoll)
# shellcheck disable=SC2016 # the inner shell's
asks='for range in "10 3" "11 2"; do set -- "$1" $range; '"$mbpolls"' -m rtu -b 19200 -P none -a 1 -o 2 -1 -0 -t 3 -r "$2" -c "$3" "$1" || exit; done'
record_by_strace() {
  local name=$1
  shift
  strace -f -o "$name.strace" "$@" bash -c "$asks" asks "$work/modbus.near" >"$name.said" 2>&1 || die "$name: $(cat "$name.said")"
  grep -q 2827 "$name.said" || die "$name: $(cat "$name.said")"
}
record_by_strace exact -xx -ttt -T -s 65536
record_by_strace plain -tt -y -s 1000
record_by_strace bare -r -x -s 1000 -e trace=desc,process
for name in exact plain bare; do
  converted "$name" strace "$name.strace"
  passes "$name" bash -c "$asks" asks '{port}'
done
"$PORTTAPE" cat exact.log >exact.cat
[[ $(grep -c -- '-  open$' exact.cat) == 2 ]] || die "exact: $(cat exact.cat)"
grep -q 'driver: 19200 baud, 8N1' exact.cat || die "exact: $(cat exact.cat)"

# What -s leaves out is told, and is a gap.
strace -f -ttt -s 2 -o short.strace bash -c "$asks" asks "$work/modbus.near" >short.said 2>&1
"$PORTTAPE" convert short.strace -o short >short.told || die "short: status $?"
grep -q 'problem .*-s 65536' short.told || die "short: $(cat short.told)"
"$PORTTAPE" verify short.log >short.verify
grep -q gap short.verify || die "short: $(cat short.verify)"

# flashrom reads a chip: a megabyte in reads of any size.
line_pair flash
"$PYTHON" -c 'import random; open("chip", "wb").write(random.Random(1).randbytes(1 << 20))'
start "$DEVICE_BIN/serprog_flash" "$work/flash.far" "$work/chip"
timeout 120 strace -f -xx -ttt -T -s 65536 -o flash.strace flashrom -p "serprog:dev=$work/flash.near:115200" \
  -c W25Q80.V -r back >flash.said 2>&1 || die "flashrom: $(cat flash.said)"
cmp back chip
rm back
converted flash strace flash.strace
passes flash flashrom -p 'serprog:dev={port}:115200' -c W25Q80.V -r back
cmp back chip

# socat's -x and -v on a line of its own; its -r and -R are what line_pair keeps.
for style in x v xv; do
  options=()
  [[ $style == *x* ]] && options+=(-x)
  [[ $style == *v* ]] && options+=(-v)
  start socat "${options[@]}" -r "$style.r" -R "$style.R" "pty,raw,echo=0,link=$work/$style" exec:"$devices/echo_lines.py" 2>"$style.log"
  wait_for "$work/$style"
  "$PYTHON" "$devices/ask_lines.py" "$work/$style" >"$style.said" || die "$style: $(cat "$style.said")"
  stop "$started"
  grep -v ' socat\[' "$style.log" >"$style.socat" || true
  converted "socat-$style" socat-x "$style.socat"
  passes "socat-$style" "$PYTHON" "$devices/ask_lines.py" '{port}'
  converted "raw-$style" socat-rR "$style.r"
  passes "raw-$style" "$PYTHON" "$devices/ask_lines.py" '{port}'
done

# Forms that are written and read: the same tape again, its opens only where the form has events.
again() {
  local of=$1 format=$2
  shift 2
  "$PORTTAPE" convert "$of.log" --to "$format" -o "form.$format" >/dev/null
  "$PORTTAPE" convert --from "$format" "form.$format" -o "again-$format" >/dev/null
  passes "again-$format" "$@"
}
for format in json text; do again exact "$format" bash -c "$asks" asks '{port}'; done
for format in csv umockdev; do again socat-xv "$format" "$PYTHON" "$devices/ask_lines.py" '{port}'; done
diff <("$PORTTAPE" cat --blocks exact.log) <("$PORTTAPE" cat --blocks again-json.log) || die "json is not exact"
say "ok: mbpoll by strace in three styles, flashrom, a program of lines by socat in six; and back by json, text, csv, umockdev"
