#!/bin/bash
# found.sh: a port that programs find (`porttape exec --as`): by pyserial, udevadm and libserialport, by its names; as the
# caller, and as a user.
# shellcheck source=lib.sh disable=SC2016
source "$(dirname "$0")/lib.sh"
need socat udevadm setpriv unshare
cd "$work"
chmod 755 "$work"
line_pair line
chmod 666 "$(readlink -f line.near)"
device=serial:$work/line.near
usb=/dev/ttyUSB94,vid=0403,pid=6001,serial=PT0001,manufacturer=FTDI,product='FT232R USB UART'
by_id="usb-FTDI_FT232R_USB_UART_PT0001-if00-port0"
as_user=()

# within COMMAND…: what it says, its stderr in the file `said`. $as is the value of --as.
within() { timeout -k 5 120 "${as_user[@]}" "$PORTTAPE" exec --device "$device" --as "$as" -- "$@" 2>said; }
expect() { # PATTERN COMMAND…
  local pattern=$1 got
  shift
  got=$(within "$@") || die "${as_user[*]} $*: exit $?: $got $(cat said)"
  grep -qE -- "$pattern" <<<"$got" || die "${as_user[*]} $*: no '$pattern': $got $(cat said)"
}

cat >list.py <<'PYTHON'
import ctypes
sp = ctypes.CDLL("libserialport.so.0")
for name in ("name", "usb_serial", "usb_product"):
    getattr(sp, "sp_get_port_" + name).restype = ctypes.c_char_p
    getattr(sp, "sp_get_port_" + name).argtypes = [ctypes.c_void_p]
ports = ctypes.POINTER(ctypes.c_void_p)()
assert sp.sp_list_ports(ctypes.byref(ports)) == 0
at = 0
while ports[at]:
    vid, pid = ctypes.c_int(), ctypes.c_int()
    port = ctypes.c_void_p(ports[at])
    sp.sp_get_port_usb_vid_pid(port, ctypes.byref(vid), ctypes.byref(pid))
    print(sp.sp_get_port_name(port).decode(), sp.sp_get_port_transport(port), f"{vid.value:04x}:{pid.value:04x}",
          sp.sp_get_port_usb_serial(port), sp.sp_get_port_usb_product(port))
    at += 1
PYTHON

finds() {
  as=$usb
  expect '^/dev/ttyUSB94 /dev/ttyUSB94$' sh -c 'echo $1 $PORTTAPE_PORT' sh '{port}'
  expect 'VID:PID=0403:6001 SER=PT0001 LOCATION=1-1' "$PYTHON" -m serial.tools.list_ports -v
  expect '^N: ttyUSB94$' udevadm info -e
  expect '^E: ID_SERIAL_SHORT=PT0001$' udevadm info -e
  expect '^E: ID_MODEL_ID=6001$' udevadm info -n /dev/ttyUSB94
  expect "^/dev/ttyUSB94 1 0403:6001 b'PT0001' b'FT232R USB UART'" "$PYTHON" list.py
  expect '^/dev/ttyUSB94$' readlink -f "/dev/serial/by-id/$by_id"
  as=/dev/ttyACM94,vid=2341,pid=0043
  expect 'VID:PID=2341:0043 LOCATION=1-1' "$PYTHON" -m serial.tools.list_ports -v
  expect '^/dev/ttyACM94 1 2341:0043' "$PYTHON" list.py
  as=/dev/ttyS0
  expect '^88:' sh -c 'printf "%s:" "$(stat -c %t /dev/ttyS0)"'
  expect '^/dev/ttyS0 *$' "$PYTHON" -m serial.tools.list_ports -v
  as=none
  expect 'porttape-' sh -c 'echo $1' sh '{port}'
}
passes() { # bytes reach the device by a name that only the command has
  as=$usb
  within sh -c "printf '%s' \"\$1\" >/dev/serial/by-id/$by_id" sh "$1" >/dev/null || die "$(cat said)"
  passed() { grep -qaF "$1" line.w.tap; }
  until_true passed "$1" || die "'$1' did not reach the device"
}

finds
passes of-the-caller
if [[ $EUID == 0 ]]; then
  as_user=(setpriv --reuid 54321 --regid 54321 --clear-groups env "TMPDIR=/tmp")
  finds
  passes of-a-user
fi
say "found by pyserial, udevadm and libserialport"

# Nothing of it is here.
[[ ! -e /dev/ttyUSB94 && ! -e /sys/class/tty/ttyUSB94 && ! -e /dev/.porttape ]] || die "left on the host"

# Of a tape: the identity is on it.
as_user=()
"$PORTTAPE" record --device "$device" --tape t -- sh -c 'printf x >$PORTTAPE_PORT' 2>said || die "cannot record: $(cat said)"
! grep -q identity t.loge || die "a pty has an identity"
sed -i '1s|"host"|"identity":{"path":"/dev/ttyUSB94","vid":"0403","pid":"6001","serial":"PT0001"},"host"|; $s|,"events_xxh3":.*|}|' t.loge
"$PORTTAPE" info t | grep -q 'identity   /dev/ttyUSB94, USB 0403:6001, serial PT0001' || die "info tells no identity"
played() { "$PORTTAPE" exec --tape t "$@" 2>said; }
played -- "$PYTHON" -m serial.tools.list_ports -v | grep -q 'VID:PID=0403:6001 SER=PT0001' || die "not found: $(cat said)"
[[ $("$PORTTAPE" test --exec --tape t -- sh -c 'printf x >/dev/ttyUSB94; echo $PORTTAPE_PORT' 2>said) == */dev/ttyUSB94* ]] ||
  die "test --exec: $(cat said)"
played --as none -- test ! -e /dev/ttyUSB94 || die "--as none: it is there"
played --as /dev/ttyUSB95 -- test -e /dev/ttyUSB95 || die "--as: $(cat said)"
# One that somebody has changed.
sed -i '1s|/dev/ttyUSB94|/dev/../etc/passwd|' t.loge
played -- sh -c 'printf x >$PORTTAPE_PORT' || die "a path that cannot be: $(cat said)"
grep -q "'/dev/../etc/passwd' has a part that begins with '.'" said || die "not told: $(cat said)"
sed -i '1s|/dev/../etc/passwd|/dev/ttyUSB94;touch PWNED;#|' t.loge
for way in 'exec --tape t' 'test --exec --tape t'; do
  # shellcheck disable=SC2086
  "$PORTTAPE" $way -- sh -c 'printf x >{port}' 2>said || die "$way: a path that is a command: $(cat said)"
  grep -q "touch PWNED;#' has other characters than letters" said || die "$way: not told: $(cat said)"
  [[ ! -e PWNED ]] || die "$way: a tape's text was run"
done
"$PORTTAPE" info t | grep -q 'identity   refused: port .* has other characters' || die "info does not tell why"
say "played, the port is the tape's"

# Where it is forbidden the command runs all the same.
user=()
[[ $EUID != 0 ]] || user=(setpriv --reuid 54321 --regid 54321 --clear-groups)
if "${user[@]}" unshare -U -c --keep-caps true 2>/dev/null; then
  "${user[@]}" unshare -U -c --keep-caps sh -c 'echo 0 >/proc/sys/user/max_user_namespaces && exec "$@"' sh \
    setpriv --inh-caps -all --ambient-caps -all "$PORTTAPE" exec --device "$device" --as "$usb" -- \
    sh -c 'printf forbidden >$PORTTAPE_PORT; printf "%s" "$PORTTAPE_PORT"' >out 2>said || die "forbidden: $(cat said)"
  grep -q 'user.max_user_namespaces' said || die "not told: $(cat said)"
  [[ $(wc -l <said) == 1 && $(<out) != /dev/* ]] || die "told: $(cat said) $(cat out)"
  say "forbidden: told, and without it"
fi
