#!/bin/bash
# alone_test.sh ALONE: each source is given to the compiler by itself, and one that does not compile is found.
set -euo pipefail
alone=$1
work=$(mktemp -d "${TMPDIR:-/tmp}/porttape-alone.XXXXXX")
trap 'rm -rf "$work"' EXIT
die() { printf 'alone: FAIL: %s\n' "$@" >&2; exit 1; }
# What stands for the compiler: it must not be asked to make code, and one source is wrong.
cat >"$work/compiler" <<'END'
#!/bin/sh
case " $* " in *" -o "* | *" -c "*) echo "it makes code: $*"; exit 1 ;; esac
case $* in *" -fsyntax-only "*/wrong.cpp) echo "wrong.cpp:1: error: no such thing"; exit 1 ;; esac
END
chmod +x "$work/compiler"
# list LAST: a build of 400 sources, the last of which is this one.
list() {
  mkdir -p "$work/build"
  for n in {1..399} "$1"; do
    printf '%s\n' "{\"directory\":\"$work\",\"file\":\"$work/$n.cpp\",\"command\":\"/x/ccache $work/compiler -DX=\\\\\\\"y\\\\\\\" -o $n.o -c $work/$n.cpp\"}"
  done | paste -sd, | sed 's/.*/[&]/' >"$work/build/compile_commands.json"
}
# gives STATUS WORDS [SECONDS]
gives() {
  local status=0
  "$alone" "$work/build" "${@:3}" >"$work/said" 2>&1 || status=$?
  [[ $status == "$1" ]] || die "status $status, not $1: $(cat "$work/said")"
  grep -qF -- "$2" "$work/said" || die "does not say '$2': $(cat "$work/said")"
}
list right
gives 0 "400 of 400 sources read by themselves: 0 do not compile"
gives 0 "400 of 400 sources read by themselves, drawn from" 600
gives 1 "no source was read in that time" 0
list wrong
gives 1 "wrong.cpp:1: error: no such thing"
gives 1 "400 of 400 sources read by themselves: 1 do not compile"
sed -i 's/},{.*}\]/}]/' "$work/build/compile_commands.json"
gives 1 "only 1 sources are listed"
