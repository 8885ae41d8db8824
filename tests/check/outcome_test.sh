#!/bin/bash
# outcome_test.sh GTEST-PROGRAM: what `outcome` makes of tests that pass, skip, fail, crash, hang and are late, once and always.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d "${TMPDIR:-/tmp}/porttape-outcome.XXXXXX")
trap 'rm -rf "$work"' EXIT
die() { echo "outcome_test: FAIL: $*" >&2; exit 1; }

# The program, with a table of its own of what is known.
mkdir -p "$work"/{tests/check,tests/support,bin,build}
cp "$here/outcome" "$work/tests/check"
cp "$here/../support/time_bound.py" "$work/tests/support"
cat >"$work/tests/README.md" <<'END'
| test | cause | since |
|---|---|---|
| `late` | it counts the stars | 2026-01-31 |
END

script() { printf '#!/bin/bash\n%s\n' "$2" >"$work/bin/$1"; chmod +x "$work/bin/$1"; }
# A file says whether a script has run before.
first_time="first() { [[ ! -e $work/\${0##*/}.ran ]] && touch $work/\${0##*/}.ran; }"
script passes 'echo all is well'
script fails 'seq 20; echo "fails: skipped: nothing, it failed"; exit 1'
script skips 'echo "skips: skipped: no device" >&2; exit 77'
script leaves_out 'echo "leaves_out: the first half"; echo "leaves_out: skipped: the second half"'
script says_nothing 'exit 77'
for name in late late.2 late.3 late.4; do
  script "$name" "$first_time; first || { echo in time; exit; }; echo '${name##*/}: bound of time: 3 s for 2 s' >&2; exit 75"
done
script late_twice 'echo "late_twice: bound of time: 3 s for 2 s"; exit 75'
script late_then_wrong "$first_time; first || { echo 'late_then_wrong: FAIL: a byte'; exit 1; }; echo 'x: bound of time: 3 s for 2 s'; exit 75"
script status_75 "$first_time; first || exit 0; echo 'a program of somebody else gave 75'; exit 75"
script hangs_once "$first_time; first || exit 0; echo it waits; sleep 600"
script hangs_and_is_wrong "$first_time; first || exit 0; echo 'hangs_and_is_wrong: FAIL: a byte is missing'; sleep 600"
script hangs_with_a_report "$first_time; first || exit 0; echo '==12==ERROR: AddressSanitizer: heap-use-after-free'; sleep 600"
script late_with_a_report "$first_time; first || exit 0; echo 'WARNING: ThreadSanitizer: data race'; echo 'x: bound of time: 3 s'; exit 75"
script loses_a_byte_once "$first_time; first || exit 0; echo 'loses_a_byte_once: FAIL: 9 of 10 bytes'; exit 1"
script crashes_once "$first_time; first || exit 0; kill -SEGV \$\$"
script has_unstable_cases 'echo "trouble: unstable: record writev.tape: it took 21 s"; echo "1 unstable"'
for ((n = 2; n < 5; n++)); do echo 'echo "trouble: unstable: case '"$n"'"'; done >"$work/cases"
script has_many_unstable_cases 'echo "trouble: unstable: case 1"; '"$(paste -sd';' "$work/cases")"

# list [--all] TEST…: runs those under ctest and sets $list and $status. WaysToEnd.NAME is one of the gtest program's.
list() {
  local test command limit all=()
  [[ ${1:-} != --all ]] || { all=(--all); shift; }
  rm -f "$work"/*.ran
  : >"$work/build/CTestTestfile.cmake"
  for test; do
    command="\"$work/bin/$test\""
    [[ $test != WaysToEnd.* ]] || command="\"$gtest\" \"--gtest_filter=$test\""
    limit=60
    [[ $test != hangs* ]] || limit=5
    cat >>"$work/build/CTestTestfile.cmake" <<END_OF_TEST
add_test($test $command)
set_tests_properties($test PROPERTIES TIMEOUT $limit SKIP_RETURN_CODE 77 SKIP_REGULAR_EXPRESSION "\\\\[  SKIPPED \\\\]")
END_OF_TEST
  done
  if "$work/tests/check/outcome" "${all[@]}" "$work/build" "$work/list" >"$work/said" 2>&1; then status=0; else status=$?; fi
  list=$(<"$work/list")
}
# expect STATUS LINE…: these lines are in the list, the last one at its end; nothing else begins with "failed" or "unstable".
expect() {
  [[ $status == "$1" ]] || die "status $status, expected $1: $list"
  shift
  diff <(grep -E '^(failed|unstable)|^  alone| passed, ' <<<"$list") <(printf '%s\n' "$@") || die "the list is: $list"
  [[ $(tail -n 1 <<<"$list") == "${*: -1}" ]] || die "its last line is not the count: $list"
}
gtest=$1

list passes fails skips leaves_out WaysToEnd.Skipped
[[ $list == "skipped: leaves_out (a part): because the second half
skipped: skips: because no device
skipped: WaysToEnd.Skipped: because no bananas here
failed: fails: status 1
$(seq 10 20 | sed 's/^/    /')
    fails: skipped: nothing, it failed
2 passed, 1 failed, 2 skipped" && $status == 1 ]] || die "status $status, the list is: $list"
list passes says_nothing
[[ $list == "skipped: says_nothing: and it does not say why"* ]] || die "no reason: $list"
expect 1 "1 passed, 1 failed, 0 skipped"
list passes not_there
[[ $list == "skipped: not_there: and it does not say why"* ]] || die "not run: $list"
expect 1 "1 passed, 1 failed, 0 skipped"
list passes
[[ $list == "1 passed, 0 failed, 0 skipped" && $status == 0 ]] || die "status $status, nothing is to be told: $list"
list
expect 1 "failed: ctest ended with 0 after 0 tests" "0 passed, 0 failed, 0 skipped"

# A test whose only fault is time runs once more, alone, after all others.
list late passes hangs_once
expect 0 "unstable: late (a bound of time): known since 2026-01-31: it counts the stars" "  alone it passed:" \
  "unstable: hangs_once (ended by its time limit): not known" "  alone it passed:" "3 passed, 0 failed, 0 skipped"
[[ $list == *"    late: bound of time: 3 s for 2 s"*"alone it passed:
    in time"*"    it waits"* ]] || die "both outputs are to be told: $list"
list --all late passes
expect 1 "unstable: late (a bound of time): known since 2026-01-31: it counts the stars" "  alone it passed:" \
  "failed: 1 tests are unstable, 0 may be" "1 passed, 1 failed, 0 skipped"
list late late.2 late.3
expect 0 "unstable: late (a bound of time): known since 2026-01-31: it counts the stars" "  alone it passed:" \
  "unstable: late.2 (a bound of time): not known" "  alone it passed:" \
  "unstable: late.3 (a bound of time): not known" "  alone it passed:" "3 passed, 0 failed, 0 skipped"
list late late.2 late.3 late.4
expect 1 "unstable: late (a bound of time): known since 2026-01-31: it counts the stars" "  alone it passed:" \
  "unstable: late.2 (a bound of time): not known" "  alone it passed:" \
  "unstable: late.3 (a bound of time): not known" "  alone it passed:" \
  "unstable: late.4 (a bound of time): not known" "  alone it passed:" \
  "failed: 4 tests are unstable, 3 may be" "0 passed, 4 failed, 0 skipped"
list late_twice passes
expect 1 "failed: late_twice: a bound of time" "  alone it failed again: a bound of time" "1 passed, 1 failed, 0 skipped"
list late_then_wrong late
expect 1 "failed: late_then_wrong: a bound of time" "  alone it failed again: status 1" \
  "failed: late: a bound of time; not run again" "0 passed, 2 failed, 0 skipped"

# A test with any other fault is red at once, though it would pass the second time.
list status_75
expect 1 "failed: status_75: status 75" "0 passed, 1 failed, 0 skipped"
list hangs_and_is_wrong hangs_with_a_report
expect 1 "failed: hangs_and_is_wrong: ended by its time limit" "failed: hangs_with_a_report: ended by its time limit" \
  "0 passed, 2 failed, 0 skipped"
list late_with_a_report loses_a_byte_once crashes_once passes
expect 1 "failed: late_with_a_report: a bound of time" "failed: loses_a_byte_once: status 1" "failed: crashes_once: SEGFAULT" \
  "1 passed, 3 failed, 0 skipped"
! grep -q 'once more, alone' "$work/said" || die "it was run once more: $(cat "$work/said")"

# A unit test ends with 75 when all assertions that failed are bounds of time, and only then.
list WaysToEnd.InTime WaysToEnd.Wrong WaysToEnd.LateAndWrong
expect 1 "failed: WaysToEnd.Wrong: status 1" "failed: WaysToEnd.LateAndWrong: status 1" "1 passed, 2 failed, 0 skipped"
list WaysToEnd.Late
expect 1 "failed: WaysToEnd.Late: a bound of time" "  alone it failed again: a bound of time" "0 passed, 1 failed, 0 skipped"
[[ $list == *'bound of time: milliseconds(2001) is 2001 ms, over seconds(2), which is 2000 ms'* ]] || die "$list"

# A test that judges its own cases prints which of them are unstable.
list has_unstable_cases passes
expect 0 "unstable: has_unstable_cases (record writev.tape: it took 21 s): not known" "2 passed, 0 failed, 0 skipped"
list has_many_unstable_cases passes
[[ $status == 1 && $list == *"1 passed, 1 failed, 0 skipped" ]] || die "four cases: $list"
