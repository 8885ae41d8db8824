#!/bin/bash
# pyserial_lines.sh PORT: pyserial with parity, signals, breaks; RTS leads to CTS, DTR to DSR and CD; the device sends back.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
timeout 120 "$PYTHON" "$(dirname "$0")/pyserial_lines.py" "$port" >"$work/found" 2>"$work/log" ||
  die "gave $?: $(tail -n 2 "$work/log"), after: $(tail -n 1 "$work/found")"
outcome <"$work/found"
