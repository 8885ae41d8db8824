#!/bin/bash
# presets.sh SOURCE: warnings are errors in every preset, and each has a build and a test preset.
set -euo pipefail
cd "$1"
work=$(mktemp -d "${TMPDIR:-/tmp}/porttape-presets.XXXXXX")
trap 'rm -rf "$work"' EXIT
names() { cmake --list-presets="$1" | sed -n 's/^ *"\([a-z]*\)".*/\1/p'; }
for preset in $(names configure); do
  # -N: shows the variables, configures nothing.
  said=$(cmake --preset "$preset" -N -B "$work/none" 2>&1) || true
  grep -q 'PORTTAPE_WERROR="ON"' <<<"$said" || { echo "preset $preset lets warnings pass" >&2; exit 1; }
done
[[ $(names configure) == *release*debug*alone*asan*tsan*coverage* ]] || { echo "a preset is missing" >&2; exit 1; }
