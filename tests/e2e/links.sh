#!/bin/bash
# links.sh: what the daemon leaves behind when a signal ends it, and what the other signals do.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
line_pair line
cd "$work"

announced() { grep -c "$work/port is there" "$work/log"; }
one_more_than() { (($(announced) > $1)); }
# A killed daemon's link may lead to another program's pty: the daemon's own word counts.
record() {
  local before
  before=$(announced) || true
  start "$PORTTAPED" record --device "serial:$work/line.near" --driver "pty:$work/port" --tape "$1" 2>>"$work/log"
  until_true one_more_than "$before" || die "$work/port did not come: $(cat "$work/log")"
}
: >"$work/log"
# The device end sends everything back.
start socat "FILE:$work/line.far,raw,echo=0" PIPE
for signal in TERM INT; do
  record "$work/$signal.log"
  talk "$work/port" hello
  kill "-$signal" "$started"
  ended "$started" || die "SIG$signal does not end porttaped"
  status_of "$started"
  [[ $status == 0 ]] || die "SIG$signal: exit $status: $(cat "$work/log")"
  [[ ! -L $work/port ]] || die "SIG$signal leaves the link behind"
  [[ $(payload "$work/$signal.logr") == hello ]] || die "SIG$signal: the tape does not hold the answer"
done
say "SIGTERM and SIGINT: exit 0, no link, tape closed"

record "$work/turn.log"
talk "$work/port" first
find . -name '*.logr' | sort >before
kill -USR1 "$started"
until_true grep -q "turn.log is complete" "$work/log" || die "SIGUSR1 does not end the tape: $(cat "$work/log")"
talk "$work/port" second
kill -TERM "$started"
status_of "$started"
[[ $status == 0 ]] || die "after SIGUSR1: exit $status: $(cat "$work/log")"
find . -name '*.logr' | sort >after
mapfile -t new < <(comm -13 before after)
[[ ${#new[@]} == 1 ]] || die "SIGUSR1 started ${#new[@]} new tapes: ${new[*]:-}"
[[ $(payload "$work/turn.logr") == first ]] || die "the first tape does not end with the first talk"
[[ $(payload "${new[0]}") == second ]] || die "the next tape does not hold the second talk"
"$PORTTAPE" verify turn.log "${new[0]}" >out 2>&1 || die "verify: $(cat out)"
say "SIGUSR1: a next tape, ${new[0]}"

record "$work/killed.log"
kill -KILL "$started"
status_of "$started"
[[ -L $work/port ]] || die "expected the killed daemon's link to be still there"
record "$work/again.log"
talk "$work/port" hello
stop "$started"
say "a killed daemon's dangling link is taken over"

start "$PORTTAPED" replay --tape "$work/TERM.log" --driver pty >"$work/name" 2>>"$work/log"
until_true test -s "$work/name" || die "pty without a link prints no name"
[[ $(wc -l <"$work/name") == 1 && -c $(cat "$work/name") ]] || die "not one line with a tty: $(cat "$work/name")"
stop "$started"
say "a pty without a link: its name on stdout"
