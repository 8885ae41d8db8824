# shellcheck shell=bash
# Sourced by scenarios/NAME.sh, which are called with DRIVER DEVICE: the tty that the unmodified driver opens and the one
# that the simulated device opens; for NAME_tcp.sh and NAME_udp.sh the ports of 127.0.0.1, for NAME_unix.sh the sockets.
# `-` starts no device. Exit status 0 only if the application's own result is right.
# shellcheck source=lib.sh
source "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
[[ $# == 2 ]] || { echo "usage: $0 DRIVER DEVICE|-" >&2; exit 64; }
driver=$1 device=$2

# sleeps PID: the process waits for something, its children too.
sleeps() { ! ps -o stat= --pid "$1" --ppid "$1" | grep -vq '^S'; }
has_device() { [[ $device != - ]]; }

# device COMMAND…: starts the device and waits until it has its tty open, unless it is replayed.
device() {
  has_device || return 0
  start "$@"
  if [[ $device =~ ^[0-9]+$ ]]; then
    wait_listening "$device"
    return
  fi
  if [[ ! -e $device ]]; then # a socket that it makes
    wait_for "$device"
    return
  fi
  until_true has_open "$started" "$device" || die "the device does not open $device"
  until_true sleeps "$started" || die "the device does not get ready" # it may still set the line up
}
