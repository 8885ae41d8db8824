#!/bin/bash
# symbols.sh LIBRARY: the soname, the symbol that driver libraries link, and that nothing else is exported.
# shellcheck source=../e2e/lib.sh
source "$(dirname "$0")/../e2e/lib.sh"
need nm readelf
readelf -d "$1" | grep -q 'SONAME.*\[libflexiport\.so\.2\]' || die "soname: $(readelf -d "$1" | grep SONAME)"
create=_ZN9flexiport10CreatePortENSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEE
nm -D --defined-only "$1" | awk '{print $NF}' >"$work/symbols"
grep -qx "$create" "$work/symbols" || die "$create is not exported"
if nm -DC --defined-only "$1" | grep -v flexiport:: >"$work/others"; then die "also exported: $(cat "$work/others")"; fi
say "$(wc -l <"$work/symbols") symbols"
