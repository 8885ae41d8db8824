#!/bin/bash
# redis_tcp.sh on a unix socket.
exec "$(dirname "$0")/redis_tcp.sh" "$@"
