#!/bin/bash
# three_ways.sh NAME [OPTION…]: a scenario directly, recorded (and compared with a second tap), and replayed with the
# given options of `porttaped replay`.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
name=$1
shift
run() {
  try "$e2e/run.sh" "$@"
  [[ $status == 77 ]] && exit 77
  [[ $status == 0 ]] || die "$* gave $status"
}
# What fails without porttape in between now and then, as lrzsz may on a loaded machine, says nothing of porttape.
"$e2e/run.sh" direct "$name" || run direct "$name"
run record "$name" "$work/tape"
"$PORTTAPE" verify "$work/tape" >/dev/null || die "porttape verify gave $?"
REPLAY_OPTS="$*" run replay "$name" "$work/tape"
