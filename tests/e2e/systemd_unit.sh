#!/bin/bash
# systemd_unit.sh BUILD-FOLDER: systemd finds nothing wrong with the installed units.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need systemd-analyze cmake
cmake --install "$1" --prefix "$work/usr" >/dev/null
mapfile -t units < <(find "$work/usr" -name '*.service' -o -name '*.socket')
[[ ${#units[@]} -gt 0 ]] || die "no unit was installed"
for unit in "${units[@]}"; do
  # The unit names the program where it will be installed; here it lies elsewhere.
  name=$(basename "$unit")
  sed "s#^\(Exec[A-Za-z]*=[-@:+!]*\)[^ ]*/\(porttaped\?\)\b#\1$work/usr/bin/\2#" "$unit" >"$work/${name/@./@test.}"
done
verify() { try systemd-analyze verify --man=no "$@" >"$work/out" 2>&1; }
# It must be seen to find something.
mkdir "$work/wrong"
printf '[Service]\nExecStart=%s/none\n' "$work" >"$work/wrong/porttape-wrong.service"
verify "$work/wrong/porttape-wrong.service"
grep -qF porttape-wrong "$work/out" || skip "systemd-analyze verifies nothing here: $(head -n 1 "$work/out")"
verify "$work"/*.service
# Units of the machine itself may have faults of their own.
if grep -F porttape "$work/out" || [[ $status != 0 && ! -s $work/out ]]; then die "systemd-analyze verify gave $status: $(cat "$work/out")"; fi
say "${#units[@]} units verified"
