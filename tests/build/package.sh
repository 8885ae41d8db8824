#!/bin/bash
# package.sh BUILD CXX: the installed CMake packages, as projects of several kinds find them.
set -euo pipefail
work=$(mktemp -d "${TMPDIR:-/tmp}/porttape-package.XXXXXX")
trap 'rm -rf "$work"' EXIT
die() { printf '%s\n' "$@" >&2; exit 1; }
build=$1 cxx=$2 prefix=$work/prefix
cmake --install "$build" --prefix "$prefix" >"$work/said" 2>&1 || die "install: $(cat "$work/said")"
for name in Porttape Flexiport; do
  [[ -d $prefix/share/cmake/$name ]] || die "no package in share/cmake/$name"
done

# project LANGUAGES BODY…: a project of that body, in $work/project.
project() {
  rm -rf "$work/project" "$work/tree"
  mkdir "$work/project"
  printf '%s\n' "cmake_minimum_required(VERSION 3.25)" "project(user LANGUAGES $1)" "${@:2}" >"$work/project/CMakeLists.txt"
}
# finds [OPTION…]: whether it configures.
finds() {
  cmake -S "$work/project" -B "$work/tree" -DCMAKE_PREFIX_PATH="$prefix" -DCMAKE_CXX_COMPILER="$cxx" "$@" >"$work/said" 2>&1
}
without=(-DCMAKE_DISABLE_FIND_PACKAGE_Boost=ON -DCMAKE_DISABLE_FIND_PACKAGE_spdlog=ON)
# shellcheck disable=SC2016  # CMake's variables
runs_programs=(
  'foreach(program tool daemon)'
  '  get_target_property(file Porttape::${program} LOCATION)'
  '  execute_process(COMMAND ${file} --version RESULT_VARIABLE status OUTPUT_VARIABLE said)'
  '  message(STATUS "${program}: ${status} ${said}")'
  'endforeach()')

for languages in NONE C CXX; do
  project "$languages" 'find_package(Porttape REQUIRED)' "${runs_programs[@]}"
  finds "${without[@]}" || die "languages $languages, neither Boost nor spdlog: $(cat "$work/said")"
  [[ $(grep -Ec '(tool|daemon): 0 porttaped? [0-9]' "$work/said") == 2 ]] || die "the programs do not run: $(cat "$work/said")"
done

project CXX 'find_package(Porttape REQUIRED)' 'add_executable(user user.cpp)' 'target_link_libraries(user Porttape::porttape)'
printf '%s\n' '#include <libport/base/version.hpp>' 'int main() { return porttape::version().empty(); }' >"$work/project/user.cpp"
finds || die "with C++, Boost and spdlog: $(cat "$work/said")"
[[ -f $work/tree/Makefile || -f $work/tree/build.ninja ]] || die "nothing was generated"

# What is missing is named.
project CXX 'find_package(Porttape REQUIRED COMPONENTS library)'
if finds "${without[@]}"; then die "found the library without Boost"; fi
grep -q 'not found: Boost spdlog' "$work/said" || die "the message does not name what is missing: $(cat "$work/said")"
project NONE 'find_package(Porttape REQUIRED COMPONENTS tool library)'
if finds; then die "found the library without a language"; fi
grep -q 'language CXX' "$work/said" || die "the message does not name the language: $(cat "$work/said")"
project NONE 'find_package(Porttape REQUIRED COMPONENTS tols)'
if finds; then die "found an unknown component"; fi
grep -q "component 'tols' is unknown" "$work/said" || die "the message does not name the component: $(cat "$work/said")"

# shellcheck disable=SC2016
project NONE 'find_package(Flexiport REQUIRED)' 'message(STATUS "at ${Flexiport_INCLUDE_DIRS}")'
finds || die "Flexiport without a language: $(cat "$work/said")"
grep -q "at $prefix" "$work/said" || die "Flexiport is not the installed one: $(cat "$work/said")"
