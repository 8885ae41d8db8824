#!/bin/bash
# readme.sh: the commands of README.md work, one after another, in an empty folder.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
need socat
src=$(cd "$e2e/../.." && pwd)
bin=$work/bin
mkdir "$work/empty" "$bin"
ln -s "$PORTTAPED" "$bin/porttaped"
ln -s "$PORTTAPE" "$bin/porttape"
{
  printf 'set -eu\ncd %q\nsrc=%q\n' "$work/empty" "$src"
  # The programs may lie elsewhere than in build/release; and a person types slower than a script runs.
  # shellcheck disable=SC2016
  sed -n '/^```sh$/,/^```$/{/^```/d;p}' "$src/README.md" | sed "s#^PATH=.*#PATH=$bin:\$PATH#; s/ &\$/ \&\nsleep 0.5/; s/^kill .*/&\nsleep 0.5/"
} >"$work/commands"
start bash "$work/commands" >"$work/out" 2>&1
status_of "$started"
[[ $status == 0 ]] || die "the commands gave $status: $(cat "$work/out")"
grep -q '"verdict": *"pass"' "$work/empty/report.json" || die "no pass in report.json: $(cat "$work/empty/report.json")"
grep -q 'as the user says' "$work/out" || die "the bug log did not fail: $(cat "$work/out")"
if [[ -f $work/empty/pid ]] && alive "$(cat "$work/empty/pid")"; then kill "$(cat "$work/empty/pid")"; fi
say "$(grep -c . "$work/commands") commands"
