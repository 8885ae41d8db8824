#!/bin/bash
# node.sh PORT: node's serialport finds its adapter and opens it, at 7E1, with its signals.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
NODE_PATH=$(dirname "$0")/../../build/drivers/node_modules timeout 120 \
  node "$(dirname "$0")/node_ports.js" "$port" >"$work/found" 2>"$work/log" || die "node gave $?: $(cat "$work/log" "$work/found")"
outcome <"$work/found"
