#!/bin/bash
# driver: hamlib's rigctl as a network client;  device: rigctld with its dummy rig.
# shellcheck source=scenario.sh
source "$(dirname "$0")/../scenario.sh"
need rigctl
if has_device; then need rigctld; fi
device rigctld -m 1 -T 127.0.0.1 -t "$device"
rig() { timeout 120 rigctl -m 2 -r "127.0.0.1:$driver" "$@" 2>/dev/null; }
rig F 14074000
[[ $(rig f) == 14074000 ]] || die "the frequency is wrong"
rig M USB 2400
[[ $(rig m | paste -sd ' ') == "USB 2400" ]] || die "the mode is wrong"
[[ $(rig F 7030000 f | tail -1) == 7030000 ]] || die "a set and a get in one session are wrong"
say "ok: frequency and mode set and read back"
