#!/bin/bash
# exec.sh PART: `porttape exec` with drivers of few words (tests/support/line_calls.c), which fail on a plain pty. PART is
#   calls    all that a pty lacks, by static and musl binaries too; recorded and against the tape
#   signals  a storm of them, waits that end by one
#   others   what else is on a driver: debuggers, a listener of its own, 32 bits, io_uring; what is forbidden here
#   ends     killed, stopped, out of descriptors: no stray process, no stuck driver
#   many N   so many runs: nothing leaks
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat gcc pgrep strace musl-gcc
support=$e2e/../support
part=$1
cd "$work"
build() { gcc -Wall -Wextra -g -O1 "${@:2}" -o "$1" "$support/${source:-line_calls.c}" -pthread || die "gcc cannot build $1"; }
build line_calls
driver=$work/line_calls
mkdir tmp
export TMPDIR=$work/tmp

# The device sends back what it gets. Like any pty it has no modem lines.
start socat "pty,raw,echo=0,link=$work/near" PIPE
wait_for "$work/near"
on_device=(exec --device "serial:$work/near,baud=115200" --lines loopback)

# run_exec WHAT OPTIONS…: sets $status; what was said is in the file `said`.
run_exec() {
  local what=$1
  shift
  try timeout -k 5 120 "$PORTTAPE" "$@" >said 2>&1
  [[ $status != 124 && $status != 137 ]] || die "$what: not at its end after 120 s: $(cat said)"
}
right() {
  run_exec "$@"
  [[ $status == 0 ]] || die "$1: exit $status: $(cat said)"
}
drivers_left() { pgrep -f "^[^ ]*$work/line_" >left; }
no_driver_left() { ! drivers_left; }
expect_no_driver() { until_true no_driver_left || die "$1: left running: $(xargs -r ps -o pid,stat,wchan:20,args -p <left)"; }

fails_on_pty() {
  try timeout 120 "$driver" "$@" near >said 2>&1
  [[ $status == 1 ]] || die "$1 on a plain pty: exit $status, expected 1: $(cat said)"
}

calls() {
  local check variant
  fails_on_pty lines
  fails_on_pty mode
  for check in lines mode nonblock copies daemon threads wait; do
    right "$check" "${on_device[@]}" -- "$driver" "$check" '{port}'
    expect_no_driver "$check"
  done
  say "signals, modes, O_NONBLOCK, copies, a daemon, threads: as on a serial port"
  build line_static -static
  musl-gcc -static -O1 -o line_musl "$support/line_calls.c" || die "musl-gcc cannot build it"
  for variant in line_static line_musl; do
    for check in lines mode wait threads; do
      right "$variant $check" "${on_device[@]}" -- "$work/$variant" "$check" '{port}'
    done
  done
  say "static and musl: the same"

  # What the device does comes at the tape's time: not within the call that led to it.
  export LINE_CALLS_PATIENT=yes
  for check in lines mode nonblock wait; do
    right "recorded $check" "${on_device[@]}" --tape "$check" --overwrite -- "$driver" "$check" '{port}'
    right "$check against the tape" test --exec --tape "$check" --check-settings --report report -- "$driver" "$check" '{port}'
    verdict_is pass report
    right "$check by the tape" exec --tape "$check" -- "$driver" "$check" '{port}'
  done
  say "recorded, and against the tape"

  # A device that speaks by its lines: CTS goes on 0.2 s after the open, and it answers.
  "$PYTHON" -c '
import sys
sys.path.insert(0, sys.argv[1])
import tapefile
tapefile.write("calls.log", [(300000, b"changed")],
               [(0, {"event": "open"})] + [(0, {"event": "modem", "line": name, "state": "off", "by": "device"})
                                           for name in ("cts", "dsr", "cd", "ri")]
               + [(200000, {"event": "modem", "line": "cts", "state": "on", "by": "device"}), (400000, {"event": "close"})])
open("calls.logw", "wb").write(tapefile.block(250000, b"changed"))' "$devices"
  right "a change of the tape's" test --exec --tape calls --report report -- "$driver" wait-device '{port}'
  verdict_is pass report
  say "TIOCMIWAIT ends by a change that is on the tape"
}

signals() {
  local times
  for ((times = 0; times < ${RUNS:-5}; times++)); do
    right storm "${on_device[@]}" -- "$driver" storm '{port}' 160000
    say "$(grep lost said)"
    right "wait" "${on_device[@]}" -- "$driver" wait '{port}'
    say "$(grep EINTR said)"
  done
  expect_no_driver storm
}

others() {
  source=line_extras.c
  build line_extras
  right strace "${on_device[@]}" -- strace -f -o trace "$driver" lines '{port}'
  grep -q 'TIOCMGET, \[TIOCM_DTR|TIOCM_RTS' trace || die "strace sees no TIOCMGET: $(grep -c . trace) lines"
  say "strace sees its calls"
  if command -v gdb >/dev/null; then
    right gdb "${on_device[@]}" -- gdb -q -nx -batch -ex 'break lines_of' -ex run -ex bt -ex delete -ex continue \
      --args "$driver" lines '{port}'
    grep -q 'check_lines' said || die "gdb does not stop it: $(cat said)"
    grep -q 'exited normally' said || die "gdb does not let it go on: $(cat said)"
    say "gdb stops it and lets it go on"
  fi
  expect_no_driver "a debugged one"

  run_exec "a listener" "${on_device[@]}" -- "$work/line_extras" notifier '{port}'
  [[ $status == 0 || $status == 3 ]] || die "a listener: exit $status: $(cat said)"
  [[ $status == 0 ]] || grep '^porttape' said | grep -qiE 'seccomp|listener' || die "the refused listener is not told: $(cat said)"
  say "a listener of its own: $(tail -n 1 said)"

  "$PYTHON" "$support/elf32.py" line_32
  try "$work/line_32" near
  if [[ $status == 25 ]]; then # ENOTTY, on a pty
    run_exec "32 bits" "${on_device[@]}" -- "$work/line_32" '{port}'
    [[ $status == 0 ]] || grep '^porttape' said | grep -q '32' || die "32 bits: exit $status, not told: $(cat said)"
    say "32 bits: exit $status $(tail -n 1 said)"
  else
    say "this machine runs no 32-bit programs"
  fi
  run_exec io_uring "${on_device[@]}" -- "$work/line_extras" uring '{port}'
  [[ $status == 0 || $status == 3 ]] || die "io_uring: exit $status: $(cat said)"
  say "io_uring: exit $status"

  # Root may look into every process, as long as it has that right.
  local without_ptrace=()
  [[ $EUID != 0 ]] || without_ptrace=(setpriv --bounding-set -sys_ptrace --inh-caps -sys_ptrace)
  try timeout -k 5 120 "${without_ptrace[@]}" "$PORTTAPE" "${on_device[@]}" -- "$work/line_extras" closed '{port}' >said 2>&1
  [[ $status == 3 ]] || die "a closed program: exit $status, expected 3: $(cat said)"
  [[ $(grep -c 'lets nobody look into its memory' said) == 1 ]] || die "a closed program is not told once: $(cat said)"
  right "an open program" "${on_device[@]}" -- "$driver" lines '{port}'
  ! grep 'look into its memory' said || die "told without need"
  say "a program that lets nobody look into its memory: told"

  # What is forbidden is told, and no driver is left in the dark.
  for call in seccomp pidfd_getfd process_vm_readv; do
    try timeout -k 5 120 "$work/line_extras" without "$call" -- "$PORTTAPE" "${on_device[@]}" -- "$driver" lines '{port}' >said 2>&1
    [[ $status == 0 ]] || grep '^porttape' said | grep -q "$call" || die "without $call: exit $status, not told: $(cat said)"
    say "without $call: exit $status $(grep -m 1 ^porttape said || true)"
  done
  expect_no_driver "one under restrictions"
}

has_lines() { [[ -e $2 && $(grep -c "$1" "$2") -ge $3 ]]; }
goes_on() { until_true has_lines calls "$1" $(($(grep -c calls "$1") + 2)) || die "$2: the driver stands still"; }

ends() {
  local times pid state
  for ((times = 0; times < ${RUNS:-5}; times++)); do
    rm -f notes waits
    start "$PORTTAPE" "${on_device[@]}" -- bash -c "\"$driver\" wait-for-ever \"\$0\" $work/waits & exec \"$driver\" for-ever \"\$0\" $work/notes" '{port}' 2>said
    until_true has_lines calls notes 1 || die "no calls: $(cat said)"
    until_true has_lines waits waits 2 || die "no waits: $(cat said)"
    kill -KILL "$started"
    status_of "$started"
    expect_no_driver "porttape killed"
    ! grep -q ': ' notes || die "porttape killed: a call failed: $(grep -m 3 ': ' notes)"
  done
  say "killed: no driver is left, and none saw a call that does not exist"

  rm -f notes
  start "$PORTTAPE" "${on_device[@]}" -- "$driver" for-ever '{port}' "$work/notes" 2>said
  pid=$started
  until_true has_lines calls notes 1 || die "no calls: $(cat said)"
  kill -STOP "$pid"
  until_true grep -q '^State:.*T' "/proc/$pid/status" || die "porttape does not stop"
  sleep 0.3
  kill -CONT "$pid"
  goes_on notes "porttape stopped and continued"
  ! grep -q ': ' notes || die "porttape stopped: a call failed: $(grep -m 3 ': ' notes)"
  say "stopped and continued: the driver goes on"
  kill -TERM "$pid"
  status_of "$pid"
  expect_no_driver "porttape ended"
  [[ $status == 143 ]] || die "SIGTERM: exit $status: $(cat said)"
  say "SIGTERM: exit $status"

  for descriptors in {3..24} 32 64; do
    try timeout -k 5 120 bash -c "ulimit -n $descriptors && exec \"\$@\"" bash "$PORTTAPE" "${on_device[@]}" -- "$driver" lines '{port}' >said 2>&1
    [[ $status != 124 && $status != 137 && $status -lt 128 ]] || die "$descriptors descriptors: exit $status: $(cat said)"
    [[ $status == 0 || $descriptors -lt 64 ]] || die "$descriptors descriptors: exit $status: $(cat said)"
    [[ $status == 0 || -s said ]] || die "$descriptors descriptors: exit $status, and no word"
    expect_no_driver "$descriptors descriptors"
  done
  say "few descriptors: told, and no driver is left"
}

processes() { pgrep -cf "$work" || true; }
at_most() { [[ $(processes) -le $1 ]]; }
mounts() { wc -l </proc/self/mountinfo; }
ptys() { cat /proc/sys/kernel/pty/nr; }

many() {
  local count=$1 before n
  before=("$(processes)" "$(mounts)" "$(ptys)")
  for ((n = 0; n < count; n++)); do
    timeout -k 5 120 "$PORTTAPE" "${on_device[@]}" -- "$driver" open '{port}' >said 2>&1 || die "run $n: exit $?: $(cat said)"
  done
  until_true at_most "${before[0]}" || die "processes left: $(pgrep -af "$work")"
  # Others of this machine come and go meanwhile.
  [[ $(($(mounts) - before[1])) -lt $((count / 4)) ]] || die "$(mounts) mounts, ${before[1]} before"
  [[ $(($(ptys) - before[2])) -lt $((count / 4)) ]] || die "$(ptys) ptys, ${before[2]} before"
  [[ -z $(ls -A tmp) ]] || die "left in TMPDIR: $(find tmp | head -n 5)"
  [[ -z $(find "$RUNTIME_DIRECTORY" -type s 2>/dev/null) ]] || die "sockets left: $(ls "$RUNTIME_DIRECTORY")"
  say "$count runs: nothing is left"
}

case $part in
  calls | signals | others | ends | many) "$@" ;;
  *) die "no part $part" ;;
esac
