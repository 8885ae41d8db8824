#!/bin/bash
# driver: whois, which reads until the server closes the connection;  device: a server that answers a line and closes.
# shellcheck source=scenario.sh
source "$(dirname "$0")/../scenario.sh"
need whois socat
# shellcheck disable=SC2016 # for the server's own shell
device socat "TCP-LISTEN:$device,bind=127.0.0.1,reuseaddr,fork" SYSTEM:'read -r name; sleep 0.05; echo "domain\: $name"; echo "status\: free"'
for name in first.example second.example third.example; do
  answer=$(timeout 120 whois -h 127.0.0.1 -p "$driver" "$name") || die "whois gave $?: $answer"
  [[ $(tr -d '\r' <<<"$answer") == *"domain: $name"*"status: free"* ]] || die "whois got: $answer"
done
say "ok: three connections, each ended by the device"
