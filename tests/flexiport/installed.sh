#!/bin/bash
# installed.sh: installs the build $BUILD, then builds and runs a program written from flexiport's public documentation
# against the package: by find_package(Flexiport), by pkg-config, and find_package(Porttape).
# shellcheck source=../e2e/lib.sh
source "$(dirname "$0")/../e2e/lib.sh"
need cmake pkg-config "${CXX:=c++}"
here=$(cd "$(dirname "$0")" && pwd)
prefix=$work/prefix
cmake --install "$BUILD" --prefix "$prefix" >"$work/said" 2>&1 || die "install: $(cat "$work/said")"
cmake -S "$here/consumer" -B "$work/build" -DCMAKE_PREFIX_PATH="$prefix" -DCMAKE_CXX_COMPILER="$CXX" \
  -DCMAKE_CXX_FLAGS="${CXXFLAGS:-}" >"$work/said" 2>&1 || die "configure: $(cat "$work/said")"
cmake --build "$work/build" >"$work/said" 2>&1 || die "build: $(cat "$work/said")"

port=$((20000 + $$ % 20000))
for part in errors serial log tcp udp tcplog; do
  mkdir "$work/$part"
  timeout 100 "$work/build/api_program" "$part" "$work/$part" "$((port += 2))" || die "$part"
done

PKG_CONFIG_PATH=$(dirname "$(find "$prefix" -name flexiport.pc)")
export PKG_CONFIG_PATH
read -ra flags < <(pkg-config --cflags --libs flexiport)
read -ra own <<<"${CXXFLAGS:-}"
"$CXX" -std=c++11 "${own[@]}" -Wall -Wextra -Werror "$here/consumer/api_program.cpp" -o "$work/by_pkg_config" "${flags[@]}" ||
  die "pkg-config gives ${flags[*]}"
LD_LIBRARY_PATH=$(pkg-config --variable=libdir flexiport) "$work/by_pkg_config" errors "$work" 1 || die "by pkg-config"

sample=$here/../../sample-logs/nmea.log
payload "${sample}r" >"$work/expected"
"$work/build/porttape_program" "$sample" >"$work/got" || die "the program on libporttape fails"
cmp "$work/expected" "$work/got" || die "the program on libporttape reads other bytes"
say "by find_package and by pkg-config"
