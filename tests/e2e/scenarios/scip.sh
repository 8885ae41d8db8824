#!/bin/bash
# driver: scip_client;  device: scip_sensor, as slow as a line of 115200 baud.
# shellcheck source=scenario.sh
source "$(dirname "$0")/../scenario.sh"
device "$devices/scip_sensor.py" "$device" --rate 11520
"$devices/scip_client.py" "$driver"
