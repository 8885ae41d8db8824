#!/bin/bash
# flashrom.sh over TCP.
exec "$(dirname "$0")/flashrom.sh" "$@"
