#!/bin/bash
# channels.sh: one channel's trouble is its own. Channels with one trouble each beside good ones: the good ones work, the
# others come up when their trouble is mended, and SIGTERM ends all with status 0.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
cd "$work"
line_pair line
start socat "FILE:$work/line.far,raw,echo=0" PIPE
free_ports taken
# shellcheck disable=SC2154 # free_ports sets it
start socat "TCP-LISTEN:$taken,bind=127.0.0.1" PIPE
listener=$started
wait_listening "$taken"
echo precious >file

cat >channels.conf <<END
[channel good]
device = serial:$work/line.near
driver = pty:$work/good
tape = $work/good.log
[channel no_device]
device = unix:$work/device.socket
driver = pty:$work/no_device
[channel no_folder]
device = unix:$work/device.socket,wait
driver = pty:$work/no_folder
tape = $work/folder/tape.log
[channel no_tape]
tape = $work/later.log
driver = pty:$work/no_tape
[channel port_taken]
device = unix:$work/device.socket,wait
driver = tcp-listen:127.0.0.1:$taken
[channel link_taken]
device = unix:$work/device.socket,wait
driver = pty:$work/file
END
start "$PORTTAPED" run channels.conf 2>log
daemon=$started
wait_for "$work/good" log
talk "$work/good" first
for name in no_device no_folder no_tape port_taken link_taken; do
  until_true grep -q "$name: .*trying again" log || die "the trouble of $name is not told: $(cat log)"
done
[[ $(cat file) == precious ]] || die "a file in the way was touched"
talk "$work/good" second
say "five troubles are told, the good channel works"

mkdir folder
cp good.logr later.logr && cp good.logw later.logw
rm file
stop "$listener"
start socat "UNIX-LISTEN:$work/device.socket,fork" PIPE
for name in no_device no_folder no_tape file; do
  until_true is_link "$work/$name" || die "$name does not come up: $(cat log)"
done
until_true listens_on "$taken" || die "port_taken does not come up: $(cat log)"
talk "$work/no_device" third
talk "$work/no_folder" fourth
talk "$work/file" fifth
[[ $(payload folder/tape.logr) == fourth ]] || die "the mended tape is not there"
say "each comes up when its trouble is mended"

kill -TERM "$daemon"
ended "$daemon" || die "SIGTERM does not end it"
status_of "$daemon"
# The replay's driver has not come: incomplete.
[[ $status == 5 ]] || die "exit $status: $(cat log)"
[[ $(payload good.logr) == $'first\nsecond' ]] || die "the good tape has $(payload good.logr)"

# After a kill the tape's name is taken: a channel of a configuration takes the next, the command line refuses.
start "$PORTTAPED" run channels.conf 2>log
wait_for "$work/good" log
talk "$work/good" sixth
until_true grep -q sixth good.2.logr || die "the tape does not come: $(cat log)" # made while the first bytes pass
kill -KILL "$started"
status_of "$started"
start "$PORTTAPED" run channels.conf 2>log
daemon=$started
until_true grep -q "good is there" log || die "it does not come up after a kill: $(cat log)"
talk "$work/good" seventh
until_true grep -q seventh good.3.logr || die "the tape does not come: $(cat log)"
stop "$daemon"
[[ $(payload good.2.logr) == sixth && $(payload good.3.logr) == seventh ]] || die "the tapes are $(ls): $(cat log)"
try "$PORTTAPED" record --device "serial:$work/line.near" --driver "pty:$work/good" --tape good 2>err
[[ $status == 2 && $(cat err) == *good.log* ]] || die "a taken name on the command line: exit $status: $(cat err)"
say "after a kill: the next tape, and exit 2 on the command line"

# Wrong configurations stop a start.
wrong() { # PATTERN < CONFIG
  cat >wrong.conf
  try timeout 120 "$PORTTAPED" run wrong.conf 2>err
  [[ $status == 2 ]] || die "exit $status: $(cat err)"
  grep -qE -- "$1" err || die "no /$1/ in: $(cat err)"
}
wrong "wrong.conf:8: tape .*channel 'a'" <<<"[channel a]
device = unix:/x
driver = pty:$work/a
tape = $work/same
[channel b]
device = unix:/x
driver = pty:$work/b
tape = $work/folder/../same.log"
wrong "wrong.conf:6: link .*channel 'a'" <<<"[channel a]
device = unix:/x
driver = pty:$work/a
[channel b]
device = unix:/x
driver = pty:$work/./a"
wrong "wrong.conf:3: .*mode.*0999" <<<"[channel a]
device = unix:/x
driver = pty:$work/a,mode=0999"
say "wrong configurations: exit 2"

if [[ -n ${SANITIZE:-} ]]; then
  say "skipped: a sanitizer needs descriptors itself, so few are not tried"
  exit 0
fi

# Descriptors for some channels only: those that are up work, however the number comes out.
for ((n = 0; n < 40; n++)); do
  printf '[channel c%d]\ndevice = unix:%s/device.socket\ndriver = pty:%s/c%d\n' "$n" "$work" "$work" "$n"
done >many.conf
for limit in 36 37; do
  start prlimit "--nofile=$limit:$limit" "$PORTTAPED" run many.conf 2>log
  daemon=$started
  until_true grep -q 'trying again' log || die "$limit descriptors are enough for 40 channels?"
  mapfile -t up < <(find . -name 'c*' -type l | sort)
  [[ ${#up[@]} -gt 4 ]] || die "only ${#up[@]} channels are up: $(cat log)"
  alive "$daemon" || die "it has ended: $(cat log)"
  for name in "${up[@]:0:3}"; do
    talk "$work/$name" "on $name"
  done
  kill -TERM "$daemon"
  ended "$daemon" || die "SIGTERM does not end it: $(cat log)"
  status_of "$daemon"
  [[ $status == 0 ]] || die "exit $status: $(tail log)"
  say "$limit descriptors: ${#up[@]} of 40 channels are up and work"
done
