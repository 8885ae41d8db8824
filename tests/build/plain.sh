#!/bin/bash
# plain.sh SOURCE CXX: a build without preset goes on after a warning, does without GoogleTest, and says so where tests were asked for.
set -euo pipefail
work=$(mktemp -d "${TMPDIR:-/tmp}/porttape-build.XXXXXX")
trap 'rm -rf "$work"' EXIT
die() { echo "$1" >&2; exit 1; }
configure() { cmake -G Ninja -S "$source" -DCMAKE_CXX_COMPILER="$cxx" -DCMAKE_BUILD_TYPE=Release "$@" >"$work/said" 2>&1; }
source=$1 cxx=$2

# Every frame is larger than one byte, so that there is something to warn of.
configure -B "$work/plain" -DBUILD_TESTING=OFF -DCMAKE_CXX_FLAGS=-Wframe-larger-than=1 || die "configure: $(cat "$work/said")"
# Sources of one room are compiled together, and for speed as far as tests/bench sees any, unless somebody says otherwise.
grep -q '^CMAKE_UNITY_BUILD:BOOL=ON' "$work/plain/CMakeCache.txt" || die "no unity build by default"
grep -q '^CMAKE_CXX_FLAGS_RELEASE:STRING=-O2' "$work/plain/CMakeCache.txt" || die "a Release build is not -O2 by default"
configure -B "$work/plain" -DCMAKE_UNITY_BUILD=OFF -DCMAKE_CXX_FLAGS_RELEASE=-O1 || die "configure: $(cat "$work/said")"
grep -q '^CMAKE_CXX_FLAGS_RELEASE:UNINITIALIZED=-O1\|^CMAKE_CXX_FLAGS_RELEASE:STRING=-O1' "$work/plain/CMakeCache.txt" ||
  die "the flags of a user are not taken"
ninja -C "$work/plain" libport/CMakeFiles/porttape.dir/base/json_text.cpp.o >"$work/said" 2>&1 || die "a warning ends the build: $(cat "$work/said")"
grep -q 'frame-larger-than' "$work/said" || die "no warning, so nothing was shown: $(cat "$work/said")"

without=(-DCMAKE_DISABLE_FIND_PACKAGE_GTest=ON -DCMAKE_DISABLE_FIND_PACKAGE_benchmark=ON)
configure -B "$work/no_gtest" "${without[@]}" || die "configure without GoogleTest: $(cat "$work/said")"
if configure -B "$work/tests_asked" "${without[@]}" -DBUILD_TESTING=ON; then die "tests without GoogleTest"; fi
grep -q 'libgtest-dev' "$work/said" || die "the message does not say what to install: $(cat "$work/said")"
