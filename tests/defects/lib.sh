# shellcheck shell=bash disable=SC2034,SC2154 # what is of the script, and for it
# Sourced by the scripts of this folder's folders: a program of ours is recorded with its counterpart, and each patch beside the
# script puts a known defect into it, which is to be caught. Gives $work (goes away at exit), the options of all of them, and loops.
# The script has, before it calls catch_all:
#   $subject                  what is tested, for what is printed; $program: its file in this folder
#   record                    makes the tape anew
#   verdict NAME PROGRAM      tests PROGRAM: sets $status, and leaves the report in $work/NAME
#   is_named NAME             whether $status and the report say what they should of this defect; told_of NAME: what that is
#   is_of_time NAME           whether the machine can hide this defect by a delay of its own
#   shown NAME                the line of the report that is printed
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

command -v "$PORTTAPE" >/dev/null || { echo "defects/$self: no $PORTTAPE; PORTTAPE names the program" >&2; exit 2; }
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

show_report() { cat "$work/$1" "$work/$1.err" >&2; }

passes() {
  local n
  for ((n = 1; n <= runs; n++)); do
    verdict unchanged "$here/$program"
    [[ $status == 0 ]] || { show_report unchanged; die "the unchanged $subject fails (run $n of $runs)"; }
  done
  echo "the unchanged $subject passed $runs of $runs"
}

# What the machine held up, now or on the tape, is late before its defect shows: both are made anew then.
catches() {
  local name try
  name=$(basename "$1" .patch)
  cp "$here/$program" "$work/"
  patch --quiet --directory "$work" --strip 1 <"$1" || die "$1 does not apply"
  for ((try = 1; ; try++)); do
    verdict "$name" "$work/$program"
    [[ $status != 0 ]] || die "$name: not caught"
    ! is_named "$name" || break
    if is_of_time "$name" && ((try < 20)); then
      record
      continue
    fi
    show_report "$name"
    [[ $status != 4 ]] || late "$name: $(head -1 "$work/$name")"
    die "$name: status $status, and not in the first five lines: $(told_of "$name")"
  done
  printf '%-20s %s  %s\n' "$name" "$status" "$(shown "$name")"
}

catch_all() {
  local patch
  record
  passes
  for patch in "${patches[@]}"; do catches "$patch"; done
  echo "${#patches[@]} defects caught"
}
