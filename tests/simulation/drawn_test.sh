#!/bin/bash
# Whether each commit has seeds of its own, which can be repeated and gone on from.
set -euo pipefail
here=$(dirname "$(readlink -f "$0")")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
fail() { echo "$*" >&2; exit 1; }
drawn() { "$here/drawn" --simulate "$1" "${@:2}"; }

a=$(drawn "$1" --commit aaaaaaaaaa --count 3 --next "$folder/next")
b=$(drawn "$1" --commit bbbbbbbbbb --count 3)
[[ ${a%%,*} != "${b%%,*}" ]] || fail "two commits have the same seeds: $a"
[[ $a == *$'\n3 seeds, '*' 0 findings' ]] || fail "not three seeds: $a"
read -r commit next <"$folder/next"
[[ $commit == aaaaaaaaaa && $a == "seeds from $((next - 3)) on"* ]] || fail "the next seed is not told: $commit $next"
on=$(drawn "$1" --commit aaaaaaaaaa --count 2 --next "$folder/next")
[[ $on == "seeds from $next on"* ]] || fail "it does not go on from $next: $on"
other=$(drawn "$1" --commit cccccccccc --count 1 --next "$folder/next")
[[ $other == "seeds from $((0xccccccccc + 1000000)) on"* ]] || fail "another commit goes on from the last one's: $other"

# For a time: at least one seed, and what it tells can be repeated.
timed=$(drawn "$1" --commit aaaaaaaaaa --for 1 --next "$folder/next")
[[ $timed =~ $'\n'"seeds "([0-9]+)\.\.([0-9]+)": "([0-9]+)" seeds" ]] || fail "no seeds for a second: $timed"
[[ ${BASH_REMATCH[1]} == "$((0xaaaaaaaaa + 1000000))" && ${BASH_REMATCH[3]} -ge 1 ]] || fail "not those: $timed"
read -r commit next <"$folder/next"
[[ $next == $((BASH_REMATCH[2] + 1)) ]] || fail "after ${BASH_REMATCH[2]} comes not $next"

# However short the time is, something is run.
for seeds in 0.. 7..; do
  short=$("$1" --seeds $seeds --for 0)
  [[ $short =~ ": "[1-9][0-9]*" seeds, " ]] || fail "no seed of $seeds is run: $short"
done

# Whoever ends it leaves no simulation behind.
"$here/drawn" --simulate "$1" --commit dddddddddd --for 600 >"$folder/ended" &
ended=$!
ours="seeds $((0xddddddddd + 1000000))\.\."
for ((n = 0; n < 600; ++n)); do
  pgrep -f "$ours" >/dev/null && break
  sleep 0.1
done
((n < 600)) || fail "it does not begin: $(<"$folder/ended")"
kill "$ended"
wait "$ended" || true
for ((n = 0; n < 600; ++n)); do
  pgrep -f "$ours" >/dev/null || break
  sleep 0.1
done
((n < 600)) || fail "a simulation is left behind: $(pgrep -af "$ours")"

# A finding is a failure, and what was found is printed. A simulation that finds something at every seed:
cat >"$folder/finds" <<'END'
#!/bin/sh
echo "seed 7: something is wrong"
echo "1 seeds, 0.0 simulated hours in 0.0 s (1 seeds/s): 1 findings"
exit 1
END
chmod +x "$folder/finds"
status=0
found=$(drawn "$folder/finds" --commit aaaaaaaaaa --count 1) || status=$?
[[ $status == 1 && $found == *"seed 7: something is wrong"* ]] || fail "a finding is no failure: $status $found"

for wrong in '--count 0' '--for' '' '--commit xyz --count 1'; do
  status=0
  # shellcheck disable=SC2086
  "$here/drawn" --simulate "$1" $wrong >/dev/null 2>&1 || status=$?
  [[ $status != 0 ]] || fail "drawn $wrong is taken"
done
status=0
"$1" --seeds 1.. >/dev/null 2>&1 || status=$?
[[ $status == 2 ]] || fail "seeds without an end, for ever"
