# shellcheck shell=bash
# Sourced by every script of this folder. Gives $work (a folder that goes away at exit), processes that end with the
# script, waiting, and the exit statuses: 0 right, 1 wrong, 75 something took too long and nothing else is wrong, 77 skipped:
# this machine has no such thing. What ./check installs or builds is never a reason to skip.
set -euo pipefail

e2e=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
devices=$e2e/../devices
: "${PORTTAPED:=porttaped}" "${PORTTAPE:=porttape}" "${PYTHON:=/usr/bin/python3}"
: "${DEVICE_BIN:=$e2e/../../build/release/tests/devices}" # modbus_slave and serprog_flash
: "${SHARED_DIR:=$e2e/../../../shared}"
self=$(basename "$0" .sh)
# shellcheck source=../support/time_bound.sh
source "$e2e/../support/time_bound.sh"
work=$(mktemp -d "${TMPDIR:-/tmp}/porttape-e2e.XXXXXX")
export RUNTIME_DIRECTORY=$work/control # daemons of other tests, and of this machine, are not seen
pids=()
# What the caller has open is no test's: some tests count descriptors.
for inherited in /proc/self/fd/*; do
  inherited=${inherited##*/}
  if ((inherited > 2 && inherited != 255)); then exec {inherited}>&-; fi
done

say() { printf '%s: %s\n' "$self" "$*"; }
die() { printf '%s: FAIL: %s\n' "$self" "$*" >&2; exit 1; }
skip() { printf '%s: skipped: %s\n' "$self" "$*" >&2; exit 77; }

need() {
  local program
  for program; do command -v "$program" >/dev/null || die "no $program; ./check installs what the tests need"; done
}

# start COMMAND…: in the background, in a process group of its own; $started is its pid. $input replaces /dev/null.
start() {
  set -m
  "$@" <"${input:-/dev/null}" &
  started=$!
  set +m
  pids+=("$started")
}

alive() { kill -0 "$1" 2>/dev/null; }

# until_true COMMAND…: tries the command until it succeeds. Status 1 when it does not within $patience seconds, which only
# end what hangs.
patience=60
until_true() {
  local limit=$((SECONDS + patience))
  until "$@"; do
    ((SECONDS < limit)) || return 1
    sleep 0.02
  done
}

# ended PID: waits for the end; status 1 when it does not come.
has_ended() { ! alive "$1"; }
ended() { until_true has_ended "$1"; }

# stop PID…: ends what start started, with all its children; by force when they do not end.
stop() {
  local pid
  for pid; do kill -TERM -- "-$pid" 2>/dev/null || true; done
  for pid; do
    ended "$pid" || say "pid $pid had to be killed" >&2
    kill -KILL -- "-$pid" 2>/dev/null || true
    wait "$pid" 2>/dev/null || true
  done
}

# status_of PID: waits and sets $status, without ending the script.
status_of() { if { wait "$1"; } 2>/dev/null; then status=0; else status=$?; fi; }

# try COMMAND…: runs it and sets $status, without ending the script.
try() { if "$@"; then status=0; else status=$?; fi; }

finish() {
  local code=$?
  trap - EXIT
  set +e
  local n
  for ((n = ${#pids[@]} - 1; n >= 0; n--)); do
    alive "${pids[n]}" && kill -CONT -- "-${pids[n]}" 2>/dev/null
    kill -0 -- "-${pids[n]}" 2>/dev/null && stop "${pids[n]}"
  done
  if [[ -n ${KEEP:-} ]]; then echo "kept $work" >&2; else rm -rf "$work"; fi
  exit "$code"
}
trap finish EXIT
trap 'exit 130' INT TERM

is_link() { [[ -e $1 ]]; } # through a link: it is there and not dangling
wait_for() { until_true is_link "$1" || die "$1 did not come${2:+: $(cat "$2")}"; }

# has_open PID PATH: whether the process, or a child of it, has that file open.
has_open() {
  local pid target
  target=$(readlink -f "$2") || return 1
  for pid in "$1" $(pgrep -P "$1"); do
    find "/proc/$pid/fd" -lname "$target" 2>/dev/null | grep -q . && return 0
  done
  return 1
}

# ask LINK WORD…: a driver that opens its port once, asks each word, and checks the answers.
ask() { "$PYTHON" -c 'import sys
sys.path.insert(0, sys.argv[1])
from line import Line
line = Line(sys.argv[2])
for word in sys.argv[3:]:
    line.write(word.encode() + b"\n")
    if line.read_until(b"\n", 60) != b"got " + word.encode() + b"\n": sys.exit("no answer to " + word)' "$devices" "$@"; }
export -f ask
export PYTHON devices
# closes LOG COUNT: so many drivers of the daemon have gone.
closes() { (($(grep -cE 'the driver has closed it|: hung up' "$1") >= $2)); }

# line_pair NAME: two joined ttys $work/NAME.near and $work/NAME.far. What passes is kept by this second tap:
# NAME.w.tap (near to far: what a driver writes) and NAME.r.tap. $started is the socat that owns them.
line_pair() {
  start socat -r "$work/$1.w.tap" -R "$work/$1.r.tap" \
    "pty,raw,echo=0,link=$work/$1.near" "pty,raw,echo=0,link=$work/$1.far"
  wait_for "$work/$1.near"
  wait_for "$work/$1.far"
}

# free_ports NAME…: sets each variable to a port of 127.0.0.1 that nobody listens on (TCP), outside the range that the
# system takes for outgoing connections.
free_ports() {
  local numbers
  read -ra numbers < <("$PYTHON" -c 'import random, socket, sys
sockets = []
while len(sockets) < len(sys.argv) - 1:
    try: sockets.append(socket.create_server(("127.0.0.1", random.randrange(10000, 32000))))
    except OSError: pass
numbers = [s.getsockname()[1] for s in sockets]
for s in sockets: s.close()
print(*numbers)' "$@")
  for ((n = 0; n < $#; n++)); do printf -v "${@:n+1:1}" %s "${numbers[n]}"; done
}
# Without connecting to it: a port of TCP or UDP, or the path of a Unix socket (which is there before it listens).
listens_on() {
  case $1 in
    /*) grep -qE " 00010000 [^/]* $1\$" /proc/net/unix ;;
    *) grep -qE "$(printf ':%04X 00000000:0000 (0A|07)' "$1")" /proc/net/tcp /proc/net/udp ;;
  esac
}
wait_listening() { until_true listens_on "$1" || die "nobody listens on $1${2:+: $(cat "$2")}"; }

payload() { "$PYTHON" "$devices/tapefile.py" payload "$1"; }

# json FILE KEY.KEY: one value of a JSON file. verdict_is WORD REPORT: the report's verdict.
json() { "$PYTHON" -c 'import json,sys
value = json.load(open(sys.argv[1]))
for key in sys.argv[2].split("."): value = value[key]
print(json.dumps(value) if isinstance(value, (dict, list, bool, type(None))) else value)' "$1" "$2"; }
verdict_is() {
  local verdict
  verdict=$(json "$2" verdict) || die "no report in $2"
  [[ $verdict == "$1" ]] || die "verdict $verdict, expected $1: $(cat "$2")"
}

# without_doubts FILE: a report without what it adds where the machine stood still for a moment.
without_doubts() { sed -e 's/, with doubts//' -e '/^  doubt  /d' "$1"; }

# converted NAME FORMAT FILE [OPTION…]: evidence in FORMAT becomes the tape NAME.log, sound and without a problem; what convert
# says is in NAME.told.
converted() {
  "$PORTTAPE" convert --from "$2" "$3" -o "$1" "${@:4}" >"$1.told" 2>&1 || die "$1: $(cat "$1.told")"
  "$PORTTAPE" verify "$1.log" >/dev/null || die "$1: verify gave $?"
  ! grep -q problem "$1.told" || die "$1: $(cat "$1.told")"
}
# passes NAME COMMAND…: the driver passes on the tape NAME.log, {port} its port; what it says is in NAME.out.
passes() {
  local name=$1
  shift
  try timeout 120 "$PORTTAPE" test --tape "$name.log" --report "$name.json" -- "$@" >"$name.out" 2>&1
  [[ $status == 0 ]] || die "$name: status $status: $(tail -20 "$name.out")"
  verdict_is pass "$name.json"
}

# keep_busy: one spinning process for each core, until quiet.
busy=()
keep_busy() {
  local n
  for ((n = 0; n < $(nproc); n++)); do
    start bash -c 'while :; do :; done'
    busy+=("$started")
  done
}
quiet() {
  stop "${busy[@]}"
  busy=()
}

# most KiB COMMAND…: it needs no more memory.
most() { "$PYTHON" -c 'import resource, subprocess, sys
subprocess.run(sys.argv[2:], check=True, stdout=subprocess.DEVNULL)
most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
if most > int(sys.argv[1]): sys.exit(f"{most} KiB: {sys.argv[2:]}")' "$@" || die "too much memory"; }

# talk LINK WORDS: writes them on a line to a device that echoes, and reads them back; `log` is shown where they do not come.
talk() {
  "$PYTHON" -c 'import sys
sys.path.insert(0, sys.argv[1])
from line import Line
line = Line(sys.argv[2])
line.write(sys.argv[3].encode() + b"\n")
got = line.read_until(b"\n", 60)
sys.exit(got != sys.argv[3].encode() + b"\n")' "$devices" "$1" "$2" || die "no answer on $1: $(cat log)"
}
