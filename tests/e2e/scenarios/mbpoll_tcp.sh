#!/bin/bash
# mbpoll_rtu.sh over TCP.
exec "$(dirname "$0")/mbpoll_rtu.sh" "$@"
