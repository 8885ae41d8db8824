#!/bin/bash
# driver: nmea_client;  device: nmea_receiver, which pushes whether anybody listens or not.
# shellcheck source=scenario.sh
source "$(dirname "$0")/../scenario.sh"
device "$devices/nmea_receiver.py" "$device"
"$devices/nmea_client.py" "$driver" --sentences 20
