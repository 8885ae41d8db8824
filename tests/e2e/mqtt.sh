#!/bin/bash
# mqtt.sh: a subscriber and a publisher at the same time, unmodified, recorded with --connections each and replayed to
# both with no broker: the same messages. Environment: RUNS (3), with all cores busy from the second on.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
PATH=$PATH:/usr/sbin # of the broker
need mosquitto mosquitto_sub mosquitto_pub
runs=${RUNS:-3} messages=20
free_ports broker driver
: "${broker:?}" "${driver:?}"

cat >"$work/broker.conf" <<END
listener $broker 127.0.0.1
allow_anonymous true
persistence false
END

# subscribed LOG: the broker, or the tape in its place, has answered the subscription.
subscribed() { grep -q 'Subscribed' "$1"; }

# clients: both, against $driver, the publisher once the subscriber has its subscription; $work/got has what came.
clients() {
  start stdbuf -oL mosquitto_sub -d -h 127.0.0.1 -p "$driver" -i the-subscriber -t test/value -q 1 -C "$messages" -W 60 \
    >"$work/sub.log" 2>&1
  local subscriber=$started
  until_true subscribed "$work/sub.log" || die "no subscription: $(cat "$work/sub.log" "$work/log")"
  for ((n = 1; n <= messages; n++)); do echo "message $n"; done |
    timeout 120 mosquitto_pub -h 127.0.0.1 -p "$driver" -i the-publisher -t test/value -q 1 -l ||
    die "the publisher failed: $(cat "$work/log")"
  status_of "$subscriber"
  [[ $status == 0 ]] || die "the subscriber ended with $status: $(cat "$work/sub.log" "$work/log")"
  grep '^message ' "$work/sub.log" >"$work/got" || die "no message came: $(cat "$work/sub.log")"
}
for ((n = 1; n <= messages; n++)); do echo "message $n"; done >"$work/expected"

for ((run = 1; run <= runs; run++)); do
  [[ $run != 2 ]] || keep_busy
  rm -f "$work"/mqtt.*
  start mosquitto -c "$work/broker.conf" >"$work/broker.log" 2>&1
  server=$started
  wait_listening "$broker" "$work/broker.log"
  start "$PORTTAPED" record --device "tcp:127.0.0.1:$broker" --driver "tcp-listen:127.0.0.1:$driver" --tape "$work/mqtt" \
    --connections each 2>"$work/log"
  daemon=$started
  wait_listening "$driver" "$work/log"
  clients
  cmp "$work/expected" "$work/got" || die "run $run: the line that records gives other messages"
  kill -TERM "$daemon"
  ended "$daemon" || die "run $run: the recorder does not end: $(cat "$work/log")"
  status_of "$daemon"
  [[ $status == 0 ]] || die "run $run: recording ended with $status: $(cat "$work/log")"
  stop "$server"
  for tape in mqtt.log mqtt.c2.log; do
    "$PORTTAPE" verify "$work/$tape" >"$work/verified" 2>&1 || die "$tape: $(cat "$work/verified")"
  done
  [[ ! -e $work/mqtt.c3.logr ]] || die "there are more tapes than connections: $(ls "$work")"

  start "$PORTTAPED" replay --tape "$work/mqtt" --driver "tcp-listen:127.0.0.1:$driver" --connections each --once \
    --report "$work/report" 2>"$work/log"
  daemon=$started
  wait_listening "$driver" "$work/log"
  clients
  cmp "$work/expected" "$work/got" || die "run $run: the replay gives other messages: $(cat "$work/log")"
  ended "$daemon" || die "run $run: replay --once does not end with the last connection: $(cat "$work/log")"
  status_of "$daemon"
  [[ $status == 0 ]] || die "run $run: replay ended with $status: $(cat "$work/log")"
  [[ $(json "$work/report" runs.count) == 2 && $(json "$work/report" runs.worst) == pass ]] ||
    die "run $run: $(cat "$work/report")"
done
say "$runs of $runs runs: $messages messages, from the broker and from the tapes"
