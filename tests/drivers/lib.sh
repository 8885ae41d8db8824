# shellcheck shell=bash
# Sourced by every script that runs a driver: NAME.sh PORT [OPTION…]. It ends with 0 where the driver's own result is
# right. Everything it starts ends with it.
# shellcheck source=../e2e/lib.sh
source "$(dirname "${BASH_SOURCE[0]}")/../e2e/lib.sh"
[[ $# -ge 1 ]] || { echo "usage: $self.sh PORT [OPTION…]" >&2; exit 64; }
# shellcheck disable=SC2034 # it is for those who source this
port=$1
shift

# outcome: each line of its input is what the driver found, which must be the same each time.
outcome() { sed 's/^/outcome: /'; }
