#!/bin/bash
# between_builds.sh BUILD [SCENARIO…]: tapes of another build (its build tree) and of this one, each played by both.
#   1. Each scenario of run.sh is recorded by one and replayed by the other.
#   2. A driver under `porttape exec` is recorded and replayed in the same way, with settings and modem lines.
#   3. Each of these tapes, and each of sample-logs, is played by both to drivers that do wrong. Both must give the same verdict.
# Exit status: 0 all as before, 1 something differs (all of it is printed), 64 wrong use. Some minutes.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
[[ $# -ge 1 && -x $1/daemon/porttaped && -x $1/tools/porttape ]] ||
  { echo "usage: between_builds.sh BUILD [SCENARIO…], where BUILD is a build tree with both programs" >&2; exit 64; }
need socat
other=$(cd "$1" && pwd)
shift
scenarios=("$@")
if [[ $# == 0 ]]; then
  for script in "$e2e"/scenarios/*.sh; do scenarios+=("$(basename "$script" .sh)"); done
fi
cd "$work"
differences=0 tried=0
differs() {
  printf '%s: DIFFERS: %s\n' "$self" "$*" >&2
  differences=$((differences + 1))
}

this_daemon=$PORTTAPED this_tool=$PORTTAPE
# by this|other COMMAND…: with the programs of that build.
by() {
  local build=$1
  shift
  if [[ $build == this ]]; then
    PORTTAPED=$this_daemon PORTTAPE=$this_tool "$@"
  else
    PORTTAPED=$other/daemon/porttaped PORTTAPE=$other/tools/porttape "$@"
  fi
}

tapes=()
for scenario in "${scenarios[@]}"; do
  for build in this other; do
    tape=$work/$scenario.$build.log
    try by "$build" "$e2e/run.sh" record "$scenario" "$tape" >said 2>&1
    if [[ $status == 77 ]]; then
      say "$scenario: skipped: $(tail -1 said)"
      continue 2
    fi
    [[ $status == 0 ]] || die "$scenario is not recorded by the ${build} build: $(cat said)"
    tapes+=("$tape")
    for player in this other; do
      tried=$((tried + 1))
      try by "$player" "$e2e/run.sh" replay "$scenario" "$tape" >said 2>&1
      [[ $status == 0 ]] || differs "$scenario, recorded by $build, replayed by $player: status $status: $(tail -3 said)"
    done
  done
  say "$scenario: recorded by each, replayed by both"
done

# The driver's settings, lines and breaks reach the tape by the supervisor alone. The device sends back what it gets.
cat >talker.py <<'END'
import fcntl, os, struct, sys, termios, tty
line = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
tty.setraw(line)
lines = struct.pack("I", termios.TIOCM_DTR | termios.TIOCM_RTS)
for turn in range(3):
    fcntl.ioctl(line, termios.TIOCMBIC if turn % 2 else termios.TIOCMBIS, lines)
    text, got = b"hello %d\n" % turn, b""
    os.write(line, text)
    termios.tcdrain(line)
    while len(got) < len(text): got += os.read(line, 100)
    if got != text: sys.exit(f"got {got}")
termios.tcsendbreak(line, 0)
END
start socat "pty,raw,echo=0,link=$work/near" PIPE
wait_for near
executed() { # BUILD OPTION…
  # shellcheck disable=SC2016 # the program's own shell expands it
  by "$1" bash -c '"$PORTTAPE" "$@"' exec exec "${@:2}" -- "$PYTHON" talker.py '{port}' >said 2>&1
}
for build in this other; do
  try executed "$build" --device "serial:$work/near,baud=115200" --lines loopback --tape "$work/exec.$build.log"
  [[ $status == 0 ]] || die "exec of the ${build} build: status $status: $(cat said)"
  tapes+=("$work/exec.$build.log")
  for player in this other; do
    tried=$((tried + 1))
    try executed "$player" --tape "$work/exec.$build.log"
    [[ $status == 0 ]] || differs "exec, recorded by $build, replayed by $player: status $status: $(tail -3 said)"
  done
done
say "exec: recorded by each, replayed by both"

# judged BUILD TAPE COMMAND: the verdict, its cause, and the exit status; nothing of times.
judged() {
  rm -f report
  # shellcheck disable=SC2016 # the program's own shell expands it
  try by "$1" bash -c '"$PORTTAPE" "$@"' test test --tape "$2" --timing none --timeout 20 --report report -- sh -c "$3" >said 2>&1
  if [[ -s report ]]; then
    verdict="$(json report verdict), exit $status, $(json report from_driver.matched) of $(json report from_driver.of)"
  else
    verdict="no report, exit $status: $(head -1 said)"
  fi
}
# shellcheck disable=SC2016 # the driver's shell expands it
drivers=(': <{port}' 'head -c 3 recorded >{port}' 'printf "not what was asked" >{port}' 'exit 0')
for sample in "$e2e"/../../sample-logs/*.logr; do tapes+=("${sample%r}"); done
for tape in "${tapes[@]}"; do
  payload "${tape}w" >recorded
  for driver in "${drivers[@]}"; do
    tried=$((tried + 1))
    judged other "$tape" "$driver"
    before=$verdict
    judged this "$tape" "$driver"
    [[ $before == "$verdict" ]] || differs "$(basename "$tape"), driver \`$driver\`: other: $before; this: $verdict"
  done
done
say "$tried runs of ${#tapes[@]} tapes, $differences differ"
[[ $differences == 0 ]]
