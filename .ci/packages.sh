# shellcheck shell=bash
# Sourced by ./check and ./demo: need_packages NAME… installs what is missing of the named Debian packages, and nothing else.
# shellcheck disable=SC2034  # the lists are for those who source this

# Programs and libraries, with whatever generator and compiler cmake finds.
plain_build=(g++ make cmake libboost1.81-dev libboost-program-options1.81-dev libspdlog-dev libxxhash-dev
  libre2-dev libtomlplusplus-dev libarchive-dev zlib1g-dev)
# The presets: Ninja, ccache, the sanitizers' clang, the unit tests.
presets=(ninja-build ccache clang libclang-rt-14-dev libgtest-dev libgmock-dev libbenchmark-dev)
# What the end-to-end tests run: lint, simulated devices, real drivers.
all_tests=(
  pkg-config python3 python3-clang python3-serial python3-pytest python3-pytest-xdist catch2 libxml2-utils patch procps socat shellcheck
  mbpoll libmodbus-dev lrzsz ckermit flashrom bc redis-tools libhamlib-utils whois systemd mosquitto mosquitto-clients
  strace musl-tools libserialport0 udev zstd tshark sigrok-cli umockdev gdb gdbserver ser2net
  chromium chromium-driver python3-selenium
)

need_packages() {
  local package missing=() as_root=()
  for package; do
    [[ $(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null) == installed ]] || missing+=("$package")
  done
  [[ ${#missing[@]} -gt 0 ]] || return 0
  echo "Installing: ${missing[*]}"
  if [[ $EUID != 0 ]]; then
    command -v sudo >/dev/null || { echo "These packages are missing, and there is no sudo to install them." >&2; return 1; }
    as_root=(sudo)
  fi
  # No service may start on this machine because of a test.
  local policy=/usr/sbin/policy-rc.d made_policy=
  if [[ ! -e $policy ]]; then
    printf '#!/bin/sh\nexit 101\n' | "${as_root[@]}" tee "$policy" >/dev/null
    "${as_root[@]}" chmod 755 "$policy"
    made_policy=yes
  fi
  local status=0
  "${as_root[@]}" apt-get update -qq </dev/null &&
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" \
      </dev/null >/dev/null || status=$?
  [[ -z $made_policy ]] || "${as_root[@]}" rm -f "$policy"
  [[ $status == 0 ]] || echo "apt-get could not install them (status $status)." >&2
  return "$status"
}
