#!/bin/bash
# genericups.sh PORT TYPE STATUS: NUT reads a UPS of that type, whose only words are the signals of its line, and holds it.
# shellcheck source=lib.sh
source "$(dirname "$0")/lib.sh"
type=$1 status_expected=$2
export NUT_CONFPATH=$work NUT_STATEPATH=$work NUT_ALTPIDPATH=$work NUT_QUIET_INIT_UPSNOTIFY=1
printf '[ups]\n driver = genericups\n port = %s\n upstype = %s\n pollinterval = 1\n' "$port" "$type" >"$work/ups.conf"
chmod 640 "$work/ups.conf"
start /lib/nut/genericups -u "$(id -un)" -a ups -F >"$work/log" 2>&1
driver=$started

# What the driver tells upsd, by its own socket.
found() {
  "$PYTHON" - "$work/genericups-ups" >"$work/found" <<'END_OF_PROGRAM'
import socket, sys
with socket.socket(socket.AF_UNIX) as driver:
    driver.settimeout(10)
    driver.connect(sys.argv[1])
    driver.sendall(b"DUMPALL\n")
    text = b""
    while b"DUMPDONE" not in text:
        text += driver.recv(4096)
print(text.decode())
END_OF_PROGRAM
}
is_there() { ! alive "$driver" || [[ -S $work/genericups-ups ]]; }
until_true is_there || die "the driver does not start: $(tail -n 5 "$work/log")"
is_right() { found 2>/dev/null && grep -qxF "SETINFO ups.status \"$status_expected\"" "$work/found"; }
alive "$driver" || die "the driver ended: $(tail -n 5 "$work/log")"
patience=2 until_true is_right || die "not $status_expected: $(cat "$work/found")"
sleep 2.2 # it reads the signals each second
is_right || die "no more after two polls: $(cat "$work/found" "$work/log")"
alive "$driver" || die "the driver ended: $(tail -n 5 "$work/log")"
grep -E '^SETINFO ups\.(status|model)' "$work/found" | outcome
stop "$driver"
