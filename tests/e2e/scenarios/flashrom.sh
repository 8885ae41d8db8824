#!/bin/bash
# driver: flashrom, which writes and then reads 1 MiB, on a tty or over TCP;  device: serprog_flash, an empty 1 MiB chip.
# shellcheck source=scenario.sh
source "$(dirname "$0")/../scenario.sh"
PATH=$PATH:/usr/sbin
need flashrom
if has_device; then [[ -x $DEVICE_BIN/serprog_flash ]] || die "serprog_flash is not built"; fi
"$PYTHON" -c 'import random, sys
open(sys.argv[1] + "/chip", "wb").write(b"\xff" * (1 << 20))
open(sys.argv[1] + "/image", "wb").write(random.Random(1).randbytes(1 << 20))' "$work"
programmer=dev=$driver:115200 line=$device
if [[ $driver =~ ^[0-9]+$ ]]; then programmer=ip=127.0.0.1:$driver line=tcp:$device; fi
device "$DEVICE_BIN/serprog_flash" "$line" "$work/chip"
job() { timeout 200 flashrom -p "serprog:$programmer" -c W25Q80.V "$@" >"$work/out" 2>&1 || die "flashrom $1: $(cat "$work/out")"; }
job -w "$work/image"
if has_device; then cmp "$work/chip" "$work/image" || die "the chip holds something else"; fi
job -r "$work/back"
cmp "$work/back" "$work/image" || die "what was read back differs"
say "ok: 1 MiB written, verified and read back"
