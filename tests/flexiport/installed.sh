#!/bin/bash
# installed.sh: installs the build $BUILD, then builds and runs a program written from flexiport's public documentation
# against the package: by find_package(Flexiport), by pkg-config, and find_package(Porttape).
# shellcheck source=../e2e/lib.sh
source "$(dirname "$0")/../e2e/lib.sh"
need cmake ninja pkg-config "${CXX:=c++}"
here=$(cd "$(dirname "$0")" && pwd)
prefix=$work/prefix
cmake --install "$BUILD" --prefix "$prefix" >"$work/said" 2>&1 || die "install: $(cat "$work/said")"
cmake -G Ninja -S "$here/consumer" -B "$work/build" -DCMAKE_PREFIX_PATH="$prefix" -DCMAKE_CXX_COMPILER="$CXX" \
  -DCMAKE_CXX_FLAGS="${CXXFLAGS:-}" >"$work/said" 2>&1 || die "configure: $(cat "$work/said")"
cmake --build "$work/build" >"$work/said" 2>&1 || die "build: $(cat "$work/said")"

# every_part PROGRAM: all that it does, each part with two ports of its own.
every_part() {
  local part
  for part in errors serial log tcp udp tcplog; do
    rm -rf "${work:?}/$part"
    mkdir "$work/$part"
    port=$(two_free_ports) || die "no two free ports in a row"
    timeout 120 "$1" "$part" "$work/$part" "$port" || die "$part"
  done
}
two_free_ports() {
  local n port next
  for ((n = 0; n < 50; n++)); do
    free_ports port
    next=$((port + 1))
    listens_on "$next" || { echo "$port"; return; }
  done
  return 1
}

every_part "$work/build/api_program"

PKG_CONFIG_PATH=$(dirname "$(find "$prefix" -name flexiport.pc)")
export PKG_CONFIG_PATH
read -ra flags < <(pkg-config --cflags --libs flexiport)
read -ra own <<<"${CXXFLAGS:-}"
"$CXX" -std=c++11 "${own[@]}" -Wall -Wextra -Werror "$here/consumer/api_program.cpp" -o "$work/by_pkg_config" "${flags[@]}" ||
  die "pkg-config gives ${flags[*]}"
LD_LIBRARY_PATH=$(pkg-config --variable=libdir flexiport) every_part "$work/by_pkg_config"

sample=$here/../../sample-logs/nmea.log
payload "${sample}r" >"$work/expected"
"$work/build/porttape_program" "$sample" >"$work/got" || die "the program on libporttape fails"
cmp "$work/expected" "$work/got" || die "the program on libporttape reads other bytes"
say "by find_package and by pkg-config"
