# shellcheck shell=bash disable=SC2034,SC2154 # what is of the script, and for it
# Sourced by the scripts of this folder's folders: a program of ours is recorded with its counterpart, and each patch beside the
# script puts a known defect into it, which is to be caught. Gives $work (goes away at exit), the options of all of them, and loops.
set -euo pipefail

: "${PORTTAPE:=porttape}"
self=$(basename "$here")
# shellcheck source=../support/time_bound.sh
source "$here/../../support/time_bound.sh"
runs=5 busy='' patches=()
while (($# > 0)); do
  case $1 in
    --runs) runs=$2; shift ;;
    --busy) busy=yes ;;
    -h | --help) usage; exit 0 ;;
    -*) usage >&2; exit 2 ;;
    *) patches+=("$(realpath "$1")") ;;
  esac
  shift
done
((${#patches[@]} > 0)) || patches=("$here"/*.patch)

work=$(mktemp -d "${TMPDIR:-/tmp}/porttape-defects.XXXXXX")
export RUNTIME_DIRECTORY=$work/control PYTHONDONTWRITEBYTECODE=1
pids=()
clean() {
  local pid
  for pid in "${pids[@]}"; do kill "$pid" 2>/dev/null || true; done
  rm -rf "$work"
}
trap clean EXIT

die() { printf 'defects/%s: FAIL: %s\n' "$self" "$*" >&2; exit 1; }

if [[ -n $busy ]]; then
  for _ in 1 2; do
    while :; do :; done &
    pids+=($!)
  done
fi

# start_device COMMAND…: a device that prints where it is: $device. end_device: ends it.
start_device() {
  local n
  rm -f "$work/place"
  "$@" >"$work/place" 2>"$work/device" &
  pids+=($!)
  for ((n = 0; n < 1000; n++)); do
    [[ ! -s $work/place ]] || break
    sleep 0.02
  done
  device=serial:$(<"$work/place")
  [[ $device != serial: ]] || die "$1 does not start: $(cat "$work/device")"
}
end_device() {
  kill "${pids[-1]}" 2>/dev/null || true
  wait "${pids[-1]}" 2>/dev/null || true
  unset 'pids[-1]'
}

# patched PROGRAM PATCH…: a copy of it with the defect, in $work.
patched() {
  cp "$1" "$work/"
  patch --quiet --directory "$work" --strip 1 <"$2" || die "$2 does not apply"
}
