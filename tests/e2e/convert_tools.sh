#!/bin/bash
# convert_tools.sh: what other recorders wrote becomes a tape that has the line's bytes, and on which the driver passes:
# umockdev-record, gdb's remotelogfile, ser2net's trace, a program's own log by Python's logging.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need umockdev-record umockdev-run gdb gdbserver ser2net socat gcc
cd "$work"

# has_bytes NAME WRITTEN READ: the tape has the bytes of these files.
has_bytes() {
  cmp <(payload "$1.logw") "$2" || die "$1: the driver's bytes are others"
  cmp <(payload "$1.logr") "$3" || die "$1: the device's bytes are others"
}
# echo_line NAME: a device that answers lines, on the pty NAME, and a tap of its own: NAME.w, NAME.r.
echo_line() {
  start socat -r "$1.w" -R "$1.r" "pty,raw,echo=0,link=$work/$1" exec:"$devices/echo_lines.py"
  wait_for "$work/$1"
}

# umockdev's way into a program is LD_PRELOAD, which the sanitizers' programs do not take; the driver here is Python.
echo_line umockdev
umockdev-record --script="$(readlink -f umockdev)=$work/umockdev.script" -- \
  "$PYTHON" "$devices/ask_lines.py" "$(readlink -f umockdev)" >said 2>&1 || die "umockdev-record: $(cat said)"
converted from-umockdev umockdev umockdev.script
has_bytes from-umockdev umockdev.w umockdev.r
passes from-umockdev "$PYTHON" "$devices/ask_lines.py" '{port}'
# And umockdev plays what we write to a driver that asks the same.
"$PORTTAPE" convert from-umockdev.log --to umockdev -o ours.script >/dev/null
printf 'P: /devices/virtual/tty/ttyTape\nN: ttyTape\nE: DEVNAME=/dev/ttyTape\nE: SUBSYSTEM=tty\nA: dev=4:64\n' >ours.umockdev
try timeout 120 umockdev-run --device ours.umockdev --script "/dev/ttyTape=ours.script" -- \
  "$PYTHON" "$devices/ask_lines.py" /dev/ttyTape >said 2>&1
[[ $status == 0 ]] || die "umockdev-run on our script: status $status: $(cat said)"
say "umockdev-record's script has the line's bytes and replays; umockdev-run plays ours"

# gdb against gdbserver, in each form of its log; the tap stands between them.
printf 'int main(void) {\n  int n = 3;\n  return n;\n}\n' >program.c
gcc -g -O0 -o program program.c || die "gcc gave $?"
debug() { # WHERE OPTION…
  timeout 120 gdb -nx -batch -ex 'set sysroot /' "${@:2}" -ex "target remote $1" -ex 'break main' -ex continue -ex next \
    -ex 'print n' -ex kill program
}
export -f debug
for base in ascii hex octal; do
  free_ports server tap
  : "${server:?}" "${tap:?}"
  start gdbserver --once "127.0.0.1:$server" ./program >gdbserver.log 2>&1
  wait_listening "$server" gdbserver.log
  start socat -r "$base.w" -R "$base.r" "TCP-LISTEN:$tap,bind=127.0.0.1,reuseaddr" "TCP:127.0.0.1:$server"
  relay=$started
  wait_listening "$tap"
  debug "127.0.0.1:$tap" -ex "set remotelogfile $work/$base.gdb" -ex "set remotelogbase $base" >said 2>&1 || die "gdb: $(cat said)"
  # shellcheck disable=SC2016 # gdb's
  grep -q '^\$1 = 3' said || die "gdb: $(cat said)"
  ended "$relay" || die "the relay does not end"
  converted "from-$base" gdb "$base.gdb"
  has_bytes "from-$base" "$base.w" "$base.r"
done
passes from-ascii bash -c 'debug "$@"' debug '{port}'
# shellcheck disable=SC2016 # gdb's
grep -q '^\$1 = 3' from-ascii.out || die "gdb against the tape: $(cat from-ascii.out)"
say "gdb's log in ascii, hex and octal has the line's bytes and replays"

# A driver over TCP, at a line that ser2net serves.
echo_line ser2net
free_ports server
cat >ser2net.yaml <<END
connection: &line
  accepter: tcp,127.0.0.1,$server
  connector: serialdev,$work/ser2net,19200n81,local
  options:
    trace-both: $work/ser2net.trace
    trace-both-timestamp: true
    trace-both-hexdump: true
END
start ser2net -n -c ser2net.yaml -P "$work/ser2net.pid" >ser2net.log 2>&1
service=$started
wait_listening "$server" ser2net.log
"$PYTHON" "$devices/ask_lines.py" "socket://127.0.0.1:$server" >said 2>&1 || die "by ser2net: $(cat said)"
until_true grep -q 'CLOSE port' ser2net.trace || die "ser2net does not close its line: $(cat ser2net.log ser2net.trace)"
stop "$service"
converted from-ser2net ser2net ser2net.trace
has_bytes from-ser2net ser2net.w ser2net.r
passes from-ser2net "$PYTHON" "$devices/ask_lines.py" '{port}'
say "ser2net's trace has the line's bytes and replays"

# A program that logs what it sends and receives, as bellows does.
cat >logging_driver.py <<'END'
import binascii, logging, serial, sys
logging.basicConfig(level=logging.DEBUG, format="%(asctime)s %(levelname)s (%(threadName)s) [meter.uart] %(message)s")
with serial.Serial(sys.argv[1], 19200, timeout=60) as port:
    for question in (b"\x01\xff'\"\n", b"second\n"):
        logging.debug("Sending: %s", binascii.hexlify(question) if len(sys.argv) > 2 else question)
        port.write(question)
        answer = port.readline()
        logging.debug("Received: %s", binascii.hexlify(answer) if len(sys.argv) > 2 else answer)
        logging.info("the meter is fine")
        if answer != b"got " + question: sys.exit(1)
END
for style in '' hex; do
  name=python$style
  echo_line "$name"
  # shellcheck disable=SC2086 # nothing, or an argument
  "$PYTHON" logging_driver.py "$work/$name" $style 2>"$name.own" || die "$name: $(cat "$name.own")"
  "$PORTTAPE" convert "$name.own" -o "from-$name" >"from-$name.told" || die "from-$name: status $?"
  grep -q 'problem  lines 3 and 6: something else; left out' "from-$name.told" || die "from-$name: $(cat "from-$name.told")"
  has_bytes "from-$name" "$name.w" "$name.r"
  passes "from-$name" "$PYTHON" logging_driver.py '{port}'
done
say "a program's own log, by Python's logging, has the line's bytes and replays"
