# shellcheck shell=bash disable=SC2154 # $self is the script's
# The helper for bounds of time, for test programs in bash; tests/README.md has the rule. $self is the name of the script.
# `late` ends a test whose only fault is that something took too long: only for a comparison of durations, and never for
# bytes that do not come.
late() { printf '%s: bound of time: %s\n' "$self" "$*" >&2; exit 75; }
