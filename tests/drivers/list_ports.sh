#!/bin/bash
# list_ports.sh PORT: a program that looks for its adapter finds it, and talks to it: by pyserial, udevadm, the names in /dev.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
timeout 120 "$PYTHON" - "$port" >"$work/found" 2>"$work/log" <<'END_OF_PROGRAM' || die "$(tail -n 1 "$work/log"): $(cat "$work/found")"
import os, sys
import serial
from serial.tools import list_ports
port = sys.argv[1]
found = [it for it in list_ports.comports() if it.vid is not None]
for it in found:
    print(it.device, f"{it.vid:04x}:{it.pid:04x}", it.serial_number, it.hwid)
if port not in [it.device for it in found]:
    sys.exit(f"{port} is not listed")
assert [it.device for it in list_ports.grep("0403:6001")] == [port], "not found by its ids"
by_id = "/dev/serial/by-id"
names = sorted(os.listdir(by_id))
print(*names)
assert [os.path.realpath(os.path.join(by_id, name)) for name in names].count(os.path.realpath(port)) == 1, names
with serial.serial_for_url("hwgrep://0403:6001", 9600, parity="E", timeout=10) as line:
    line.write(b"who is there")
    print(line.name, line.read(12))
END_OF_PROGRAM
outcome <"$work/found"
timeout 120 udevadm info -e >"$work/udev" || die "udevadm gave $?"
awk -v RS= -v name="DEVNAME=$port" 'index($0, name "\n")' "$work/udev" >"$work/entry"
grep -E '^E: (DEVNAME|SUBSYSTEM|ID_VENDOR_ID|ID_MODEL_ID|ID_SERIAL_SHORT)=' "$work/entry" | sort | outcome
for key in ID_VENDOR_ID=0403 ID_MODEL_ID=6001 ID_SERIAL_SHORT=PT1; do
  grep -q "^E: $key" "$work/entry" || die "udevadm has no $key: $(cat "$work/entry")"
done
