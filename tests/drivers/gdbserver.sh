#!/bin/bash
# gdbserver.sh [--runs N] [--load N]: gdb on a program under gdbserver, over a tty, recorded; then the same backtrace from the
# tape, with no program. See --help.
usage() {
  cat <<'END'
usage: tests/drivers/gdbserver.sh [--runs N] [--load N]

N times (5): a program runs under gdbserver on a tty, gdb attaches through `porttape record`, stops in a function, shows the backtrace
and lets the program end. Then gdb does the same under `porttape test`, without gdbserver and program: what it prints is to be
the same, and the verdict pass. --load N: beside N busy processes. Needs gdb, gdbserver, gcc, socat (Debian packages of these names); it is no
part of ./check. PORTTAPE is the program (porttape). Exit status: 0 all is right, 1 something is not, 2 wrong use, 77 a program is missing.
END
}
runs=5 load=0
while (($# > 0)); do
  case $1 in
    --runs) runs=$2; shift ;;
    --load) load=$2; shift ;;
    -h | --help) usage; exit 0 ;;
    *) usage >&2; exit 2 ;;
  esac
  shift
done
# shellcheck source=../e2e/lib.sh
source "$(dirname "${BASH_SOURCE[0]}")/../e2e/lib.sh"
for program in gdb gdbserver gcc socat; do
  command -v "$program" >/dev/null || skip "no $program; type apt-get install $program"
done
cd "$work"

cat >program.c <<'END'
#include <stdio.h>
static int third(int n) { return n * n; }
static int second(int n) { return third(n + 1); }
static int first(int n) { return second(2 * n); }
int main(void) { return printf("%d\n", first(20)) < 0; }
END
gcc -g -O0 -o program program.c
cat >commands <<'END'
set pagination off
set confirm off
break third
continue
echo --- backtrace\n
backtrace
print n
finish
continue
END
debugger=(gdb -q -nx -batch -ex 'target remote {port}' -x commands program)
of_interest() { sed -n '/^--- backtrace/,$p' "$1"; }

for ((n = 0; n < load; n++)); do start bash -c 'while :; do :; done'; done
line_pair line
for ((run = 1; run <= runs; run++)); do
  start gdbserver --once "$work/line.far" ./program >served 2>&1
  server=$started
  until_true has_open "$server" "$work/line.far" || die "it does not open its line: $(cat served)"
  begun=$(date +%s%N)
  timeout 120 "$PORTTAPE" record --device "serial:$work/line.near" --tape gdb --overwrite -- "${debugger[@]}" >recorded 2>said ||
    die "run $run: gdb gives $? on its program: $(cat recorded said served)"
  stop "$server" # on a tty it waits for another debugger
  of_interest recorded | grep -qF '#3 ' || die "run $run: no backtrace of four functions: $(cat recorded said)"
  "$PORTTAPE" verify gdb >verified || die "run $run: $(cat verified)"
  middle=$(date +%s%N)
  try timeout 120 "$PORTTAPE" test --tape gdb --report report.json -- "${debugger[@]}" >replayed 2>said
  ended=$(date +%s%N)
  [[ $status == 0 ]] || die "run $run: from the tape status $status: $(cat replayed said)"
  verdict_is pass report.json
  # Behind gdb's own words stands the verdict.
  diff <(of_interest recorded) <(of_interest replayed | grep -v '^pass ') >differs || die "run $run: it prints something else: $(cat differs)"
  say "run $run: the same backtrace; $(json report.json to_driver.bytes) bytes from the tape, $(json report.json from_driver.matched)" \
    "of $(json report.json from_driver.of) of gdb's as recorded; $(((middle - begun) / 1000000)) ms recorded, $(((ended - middle) / 1000000)) ms replayed"
done
say "ok: $runs of $runs"
