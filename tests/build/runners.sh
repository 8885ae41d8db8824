#!/bin/bash
# runners.sh BUILD CXX ctest|pytest|cpp: a test runner of people's, by a project outside the source, on an installed tree.
set -euo pipefail
build=$1 cxx=$2 which=$3
here=$(dirname "$(readlink -f "$0")")
source=$here/../..
# Always the same place, so that ccache knows what it has compiled.
work=$(readlink -f "$build")/runners-$which
rm -rf "$work"
mkdir "$work"
die() { printf '%s\n' "$@" >&2; exit 1; }
prefix=$work/prefix
cmake --install "$build" --prefix "$prefix" >"$work/said" 2>&1 || die "install: $(cat "$work/said")"
cp -r "$here/runners/." "$work"
# One exchange: "ask\n" is answered by "42\n".
mkdir -p "$work/tapes"
printf '\0\0\0\0\0\0\3\xe8\0\0\0\4ask\n' >"$work/tapes/ask.logw"
printf '\0\0\0\0\0\0\7\xd0\0\0\0\00342\n' >"$work/tapes/ask.logr"
cp "$source"/sample-logs/bug_meter.log? "$work/tapes"
cp -r "$work/tapes" "$work/$which"
client=$(readlink -f "$source/tests/devices/meter_client.py")

# runs STATUS COMMAND…: with that status; what it said is in $work/said.
runs() {
  local status=0
  "${@:2}" >"$work/said" 2>&1 </dev/null || status=$?
  [[ $status == "$1" ]] || die "status $status, not $1: ${*:2}" "$(cat "$work/said")"
}
says() { grep -qE -- "$1" "$work/said" || die "does not say '$1':" "$(cat "$work/said")"; }
never_says() { if grep -qE -- "$1" "$work/said"; then die "says '$1':" "$(cat "$work/said")"; fi; }
configure() { cmake -S "$1" -B "$1/build" -DCMAKE_PREFIX_PATH="$prefix" "${@:2}"; }

if [[ $which == ctest ]]; then
  odd="a;--;b \$x \"q\" [z]==] \\w'"
  mkdir "$work/ctest/folder" "$work/ctest/$odd" && touch "$work/ctest/folder/here" "$work/ctest/$odd/here"
  for letter in r w e; do cp "$work/tapes/bug_meter.log$letter" "$work/ctest/tapes/$odd.log$letter"; done
  printf "%s\n" "[[redact]]" "name = 'none'" "text = 'no such text'" >"$work/ctest/tapes/$odd.rules"
  runs 0 configure "$work/ctest" -DCLIENT="$client" -DCMAKE_DISABLE_FIND_PACKAGE_Boost=ON -DCMAKE_DISABLE_FIND_PACKAGE_spdlog=ON
  runs 8 ctest --test-dir "$work/ctest/build" --output-on-failure -j 3
  says '80% tests passed, 1 tests failed out of 5'
  says 'red .*\(Failed\)'
  says '^failed: the driver did all as recorded, but the command ended with status 1'
  runs 0 ctest --test-dir "$work/ctest/build" -R 'green|folder|words|odd'
  # What is missing, or too much, is an error where it stands.
  mkdir "$work/wrong"
  for call in 'NAME a TAPE b' 'NAME a TAPE b COMMAND c LATER d' 'TAPE b COMMAND c'; do
    printf '%s\n' 'cmake_minimum_required(VERSION 3.25)' 'project(a LANGUAGES NONE)' 'find_package(Porttape REQUIRED)' \
      "porttape_add_test($call)" >"$work/wrong/CMakeLists.txt"
    if [[ $call == *LATER* ]]; then runs 0 configure "$work/wrong"; else runs 1 configure "$work/wrong" && says 'is missing; write'; fi
  done
fi

if [[ $which == pytest ]]; then
  modules=("$prefix"/lib/python3*/dist-packages)
  pytest() { PYTHONPATH=${modules[0]} PYTHONDONTWRITEBYTECODE=1 METER_CLIENT=$client /usr/bin/python3 -m pytest -p no:cacheprovider "$@"; }
  cd "$work/pytest"
  printf '%s\n' 'import os, pytest' '@pytest.fixture' 'def client(): return os.environ["METER_CLIENT"]' >>conftest.py
  runs 0 pytest -q test_green.py --strict-markers
  says '22 passed, 2 skipped'
  runs 0 pytest -q test_green.py -n 4
  says '22 passed, 2 skipped'
  mkdir tmp
  TMPDIR=$PWD/tmp runs 0 pytest -q test_module.py
  says '4 passed'
  [[ -z $(ls -A tmp) ]] || die "a folder is left: $(ls -A tmp)"
  runs 1 pytest test_red.py -o addopts=
  says '5 failed, 1 skipped, 1 xfailed, ([0-9]+ warnings?, )?6 errors|7 failed, 1 skipped, 1 xfailed, ([0-9]+ warnings?, )?4 errors'
  says 'the test has a tape, which only its fixture plays'
  never_says '^  (repeat|step) '
  says '^data mismatch: the driver wrote "axk'
  says '^the test then failed itself: test_red.py:[0-9]+: OSError: '
  says '^incomplete: '
  says '^E +assert 1 == 2'
  says '^-+ Captured porttape call -+'
  says "porttape: no tape '.*none'"
  says "porttape: option 'strictness'"
  says '^incomplete: the driver never opened its port'
  never_says 'During handling'
  says 'the test names no tape: @pytest.mark.porttape'
  never_says 'teardown|porttape/(pytest|__init__).py'
  runs 0 pytest test_doubt.py
  says 'porttape: doubt: 2 bytes of 3 .* were not read'
  says '1 passed, [0-9]+ warning'
  for test in other_data nothing_written; do
    runs 1 pytest -q "test_red.py::test_$test"
    [[ $(wc -l <"$work/said") -lt 25 ]] || die "a long story:" "$(cat "$work/said")"
  done
  cd "$work"
fi

if [[ $which == cpp ]]; then
  launcher=$(command -v ccache || true)
  runs 0 configure "$work/cpp" -DCMAKE_CXX_COMPILER="$cxx" ${launcher:+-DCMAKE_CXX_COMPILER_LAUNCHER="$launcher"}
  runs 0 cmake --build "$work/cpp/build" -j 2
  cd "$work/cpp"
  runs 1 build/with_gtest
  says '^\[       OK \] Ask.Green'
  says '^\[  FAILED  \] Ask.Red'
  says '^data mismatch: the driver wrote "axk'
  runs 1 build/with_catch
  says 'test cases: 2 \| 1 passed \| 1 failed'
  says 'data mismatch: the driver wrote "axk'
  runs 0 ctest --test-dir build
fi
