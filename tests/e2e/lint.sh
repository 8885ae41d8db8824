#!/bin/bash
# lint.sh: shellcheck finds nothing in the scripts of the tree.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need shellcheck
cd "$e2e/../.."
mapfile -t scripts < <(printf '%s\n' demo check .ci/run .ci/packages.sh sample-logs/record-all tests/fuzz/run tests/defects/driver/run \
    tests/mutants/run
  find tests -name '*.sh' | sort)
shellcheck "${scripts[@]}"
say "${#scripts[@]} scripts"
