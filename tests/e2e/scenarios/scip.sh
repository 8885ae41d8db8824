#!/bin/bash
# driver: scip_client;  device: scip_sensor.
# shellcheck source=scenario.sh
source "$(dirname "$0")/../scenario.sh"
device "$devices/scip_sensor.py" "$device"
"$devices/scip_client.py" "$driver"
