#!/bin/bash
# ser2net.sh PORT: ser2net offers the port on the network (RFC 2217); a client sets rate after rate,
# stop bits and flow control, and has what it writes sent back each time.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
free_ports tcp
# shellcheck disable=SC2154 # free_ports sets it
cat >"$work/ser2net.yaml" <<END_OF_CONFIGURATION
connection: &line
  accepter: telnet(rfc2217),tcp,127.0.0.1,$tcp
  connector: serialdev,$port,9600n81,local
END_OF_CONFIGURATION
start ser2net -n -d -c "$work/ser2net.yaml" >"$work/log" 2>&1
ser2net=$started
wait_listening "$tcp" "$work/log"
timeout 120 "$PYTHON" "$(dirname "$0")/rfc2217_client.py" "$tcp" >"$work/said" 2>&1 ||
  die "the client: $(tail -n 5 "$work/said"); ser2net: $(tail -3 "$work/log")"
kill "$ser2net"
ended "$ser2net" || die "ser2net does not end"
say "all came back"
