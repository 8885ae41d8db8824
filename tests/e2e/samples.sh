#!/bin/bash
# samples.sh: each sample tape still gives its golden dump, and still plays to its driver.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
cd "$e2e/../../sample-logs"
count=0 unplayed=""
for golden in *.golden; do
  name=${golden%.golden}
  count=$((count + 1))
  "$PORTTAPE" verify "$name.log" >"$work/out" 2>&1 || die "$name: verify: $(cat "$work/out")"
  "$PORTTAPE" cat "$name.log" >"$work/cat"
  diff "$golden" "$work/cat" || die "$name: cat differs from $golden (sample-logs/record-all makes it anew)"
  grep -q '"host":"sample"' "$name.loge" || die "$name.loge names a machine"
  scenario=$name
  [[ $name == modbus_rtu ]] && scenario=mbpoll_rtu
  SIZE=4096 try "$e2e/run.sh" replay "$scenario" "$name.log"
  case $status in
    0) ;;
    77) unplayed+=" $name" ;;
    *) die "$name does not play to its driver" ;;
  esac
done
[[ $count -gt 0 ]] || die "no samples"

# The reported bug: on its tape the driver fails every time, and the corrected driver does not.
try "$PORTTAPE" test --tape bug_meter.log --timeout 60 -- "$devices/meter_client.py" '{port}' --fixed >"$work/out" 2>&1
[[ $status == 0 ]] || die "the corrected driver does not pass: $(cat "$work/out")"
say "$count samples: goldens right, played${unplayed:+ (not, for want of a program:$unplayed)}; the bug's fix passes"
