#!/bin/bash
# view.sh: the page of a tape, and of two, in a real browser: clicks, keys, search, addresses, zoom, colours. Without
# chromium, its driver and selenium it is skipped. KEEP=1 keeps the screenshots.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"

# A browser writes into the home of its user.
export HOME=$work/home TMPDIR=$work
mkdir -p "$HOME" "$work/pages"
try "$PYTHON" "$e2e/../view/page_test.py" "$PORTTAPE" "$work/pages" >"$work/out" 2>&1
[[ $status == 77 ]] && skip "$(tail -n 1 "$work/out")"
[[ $status == 0 ]] || die "$(cat "$work/out")"
say "one tape and two: found, searched, zoomed, linked, in both colours"
