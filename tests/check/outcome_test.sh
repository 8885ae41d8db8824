#!/bin/bash
# outcome_test.sh GTEST-PROGRAM: the list has each skipped test with its reason and each failed one with its last lines, and
# nothing else; a test that was skipped without a reason, or did not run, makes it fail.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d "${TMPDIR:-/tmp}/porttape-outcome.XXXXXX")
trap 'rm -rf "$work"' EXIT
die() { echo "$1" >&2; exit 1; }

script() { printf '#!/bin/sh\n%s\n' "$2" >"$work/$1"; chmod +x "$work/$1"; }
script passes 'echo all is well'
script fails 'seq 20; echo "fails: skipped: nothing, it failed"; exit 1'
script skips 'echo "skips: skipped: no device" >&2; exit 77'
script leaves_out 'echo "leaves_out: the first half"; echo "leaves_out: skipped: the second half"'
script says_nothing 'exit 77'

# list TEST…: runs those under ctest and sets $list and $status.
list() {
  : >"$work/CTestTestfile.cmake"
  local test
  for test; do
    cat >>"$work/CTestTestfile.cmake" <<END_OF_TEST
add_test($test "$work/$test")
set_tests_properties($test PROPERTIES SKIP_RETURN_CODE 77 SKIP_REGULAR_EXPRESSION "\\\\[  SKIPPED \\\\]")
END_OF_TEST
  done
  (cd "$work" && ctest --output-junit "$work/tests.xml" >"$work/said" 2>&1) || true
  if list=$("$here/outcome" "$work/tests.xml" 2>&1); then status=0; else status=$?; fi
}

ln -s "$1" "$work/gtest"
list passes fails skips leaves_out gtest
[[ $list == "skipped: skips: because no device
skipped: leaves_out (a part): because the second half
skipped: gtest: because no bananas here
failed: fails
$(seq 10 20 | sed 's/^/    /')
    fails: skipped: nothing, it failed" ]] || die "the list is: $list"
[[ $status == 0 ]] || die "status $status where each reason is told"

list passes says_nothing
[[ $list == "skipped: says_nothing: and it does not say why"* && $status == 1 ]] || die "status $status, no reason: $list"
list passes not_there
[[ $list == "skipped: not_there: and it does not say why"* && $status == 1 ]] || die "status $status, not run: $list"
list passes
[[ -z $list && $status == 0 ]] || die "status $status, nothing was skipped: $list"
