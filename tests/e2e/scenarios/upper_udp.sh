#!/bin/bash
# driver: socat, a new one for each datagram;  device: a server that answers each datagram in capitals.
# shellcheck source=scenario.sh
source "$(dirname "$0")/../scenario.sh"
need socat tr
device socat "UDP-RECVFROM:$device,bind=127.0.0.1,fork" 'SYSTEM:tr a-z A-Z'
for word in ping pong "a longer line, in one datagram" ping; do
  answer=$(timeout 120 socat -t 60 - "UDP:127.0.0.1:$driver,readbytes=$((${#word} + 1))" <<<"$word") || die "socat gave $?"
  [[ $answer == "${word^^}" ]] || die "asked '$word', got '$answer'"
done
say "ok: four datagrams and their answers"
