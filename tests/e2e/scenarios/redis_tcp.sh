#!/bin/bash
# driver: redis-cli, which sets and gets a value of 1 MB (twice SIZE bytes);  device: a private redis-server that keeps nothing.
# shellcheck source=scenario.sh
source "$(dirname "$0")/../scenario.sh"
need redis-cli
if has_device; then
  # The server is redis-check-rdb under another name; the package redis-server would only add a service to that.
  need redis-check-rdb
  ln -s "$(command -v redis-check-rdb)" "$work/redis-server"
fi
address=(--bind 127.0.0.1 --port "$device") server=(-h 127.0.0.1 -p "$driver")
if [[ $driver == /* ]]; then address=(--port 0 --unixsocket "$device") server=(-s "$driver"); fi
device "$work/redis-server" "${address[@]}" --dir "$work" --save '' --appendonly no --logfile "$work/server.log"
cli() { timeout 120 redis-cli "${server[@]}" "$@"; }
size=${SIZE:-500000}
"$PYTHON" -c 'import random, sys; print(random.Random(1).randbytes(int(sys.argv[1])).hex(), end="")' "$size" >"$work/value"
[[ $(cli -x set key <"$work/value") == OK ]] || die "set gave no OK"
cli --raw get key >"$work/back"
cmp -n "$((2 * size))" "$work/value" "$work/back" || die "the value came back different"
[[ $(cli strlen key) == "$((2 * size))" ]] || die "strlen is wrong"
for n in 1 2 3 4 5; do [[ $(cli incr counter) == "$n" ]] || die "incr gave something other than $n"; done
[[ $(printf 'PING\r\n' | cli) == PONG ]] || die "no PONG"
say "ok: $((2 * size)) bytes set and got, counters, a pipe"
