#!/bin/bash
# samples.sh: each sample tape still gives its golden dump, tells nothing of a machine, and still plays to its driver where
# that is one of the scenarios (the others are played by tests/drivers/run).
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
cd "$e2e/../../sample-logs"
names=() unplayed="" played=0
while IFS='|' read -r name _ _ _ from _; do
  name=${name// /}
  [[ $name != \#* ]] || continue
  read -r kind scenario <<<"$from"
  names+=("$name")
  "$PORTTAPE" verify "$name.log" >"$work/out" 2>&1 || die "$name: verify: $(cat "$work/out")"
  "$PORTTAPE" cat "$name.log" >"$work/cat"
  diff "$name.golden" "$work/cat" || die "$name: cat differs from $name.golden (sample-logs/record-all makes it anew)"
  grep -q '"host":"sample"' "$name.loge" || die "$name.loge names a machine"
  head -n 1 "$name.loge" | grep -q '"boot"' && die "$name.loge names a boot"
  [[ $kind == scenario ]] || continue
  SIZE=4096 try "$e2e/run.sh" replay "$scenario" "$name.log"
  case $status in
    0) played=$((played + 1)) ;;
    77) unplayed+=" $name" ;;
    *) die "$name does not play to its driver" ;;
  esac
done <samples
tapes=(*.loge)
[[ ${#names[@]} -ge 20 && ${#tapes[@]} == "${#names[@]}" ]] || die "samples tells of ${#names[@]} tapes, ${#tapes[@]} are here"

# The reported bug: on its tape the driver fails every time, and the corrected driver does not.
try "$PORTTAPE" test --tape bug_meter.log --timeout 60 -- "$devices/meter_client.py" '{port}' --fixed >"$work/out" 2>&1
[[ $status == 0 ]] || die "the corrected driver does not pass: $(cat "$work/out")"
say "${#names[@]} samples: goldens right, $played played${unplayed:+ (not, for want of a program:$unplayed)}; the bug's fix passes"
