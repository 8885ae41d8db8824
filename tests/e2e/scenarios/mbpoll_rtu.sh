#!/bin/bash
# driver: mbpoll, which opens and closes the port (or connects) for each of ten questions;  device: a Modbus slave.
# shellcheck source=scenario.sh
source "$(dirname "$0")/../scenario.sh"
need mbpoll
if has_device; then [[ -x $DEVICE_BIN/modbus_slave ]] || die "modbus_slave is not built; ./check installs libmodbus-dev"; fi
mode=(-m rtu -b 19200 -P none -d 8 -s 1) line=("$device" 19200)
if [[ $driver =~ ^[0-9]+$ ]]; then
  mode=(-m tcp -p "$driver") line=("tcp:$device")
  driver=127.0.0.1
fi
device "$DEVICE_BIN/modbus_slave" "${line[@]}"

ask() { timeout 120 mbpoll "${mode[@]}" -a 1 -o 10 -1 -0 "$@" 2>&1; }
values() { sed -n 's/^\[[0-9]*\]: *\t*\([-0-9]*\).*/\1/p' | paste -sd ' '; }
expect() {
  local want=$1 got
  shift
  got=$(ask "$@" | values) || true
  [[ $got == "$want" ]] || die "mbpoll $*: wanted $want, got $got"
  if [[ -n ${VERBOSE:-} ]]; then echo "mbpoll ${*:1:$#-1}: $(cut -c1-60 <<<"$got")"; fi
}

expect "1000 1001 1002 1003 1004" -t 4 -r 0 -c 5 "$driver"
expect "2570 2827 3084" -t 3 -r 10 -c 3 "$driver"
expect "0 1 0 1 0 1 0 1" -t 0 -r 0 -c 8 "$driver"
expect "1 0 0 1" -t 1 -r 0 -c 4 "$driver"
ask -t 4 -r 20 "$driver" 111 222 333 >"$work/out" || die "write: $(cat "$work/out")"
expect "1019 111 222 333 1023" -t 4 -r 19 -c 5 "$driver"
ask -t 0 -r 3 "$driver" 0 >"$work/out" || die "coil: $(cat "$work/out")"
expect "0 1 0 0 0" -t 0 -r 0 -c 5 "$driver"
ask -t 4 -r 300 -c 1 "$driver" >"$work/out" || true
grep -q 'Illegal data address' "$work/out" || die "no exception 2: $(cat "$work/out")"
expect "$(seq -s ' ' 1100 1224)" -t 4 -r 100 -c 125 "$driver"
say "ok: registers, inputs, coils, writes read back, an exception, 125 registers at once"
