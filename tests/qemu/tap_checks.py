"""`porttape exec --tap` on real ttys: the driver has the device itself, and it and the device are as without Porttape.

Each driver runs twice, bare and under the verb: it says the same, and the device is told the same (`wire`).
"""

import contextlib
import fcntl
import json
import os
import pathlib
import struct
import subprocess
import sys
import termios
import threading

from exec_checks import (REPLAYED, TIOCM_LOOP, STEPS, USER, driver, looped, need_ftdi, replayed, same, supervised, taped_of_driver)
from rig import (HERE, PATIENCE, PORTTAPE, PYTHON, command, contains_in_order, events, far, need, need_sound, plug,
                 unplug, until, wire)

sys.path.insert(0, str(HERE.parent / "devices"))
import tapefile  # noqa: E402

TIOCM_OUT2 = 0x4000

# What passes, in the order of STEPS, as the tape has it.
LINE = b"x" * 500 + b"\n"
WRITTEN = b"hello\nat 7E1\nat 8O1\n" + LINE + b"bye\n"
PASSED = ["w hello", "r HELLO", "dtr off", "dtr on", "rts off", "rts on", "7 even", "w at 7E1", "r AT 7e1", "8 odd", "w at 8O1",
          "r AT 8o1", f"w {'x' * 500}", "drain", f"r {'X' * 500}", "break on", "break off", "w bye", "r BYE"]


def drop_carrier(fd):
    """Of ttyACM0, which keeps what it was last told while it was open."""
    def carrier():
        bits = bytearray(4)
        fcntl.ioctl(fd, termios.TIOCMGET, bits)
        return bool(struct.unpack("i", bits)[0] & termios.TIOCM_CD)

    other = os.open("/dev/ttyGS0", os.O_RDWR | os.O_NOCTTY)
    try:
        until(carrier, "no carrier comes")
    finally:
        os.close(other)
    until(lambda: not carrier(), "the carrier stays on")


def make_fresh(device, local):
    fd = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        mode = termios.tcgetattr(fd)
        mode[0] = mode[1] = mode[3] = 0
        mode[2] = termios.CS8 | termios.CREAD | termios.HUPCL | termios.CLOCAL
        mode[4] = mode[5] = termios.B57600
        termios.tcsetattr(fd, termios.TCSANOW, mode)
        termios.tcflush(fd, termios.TCIOFLUSH)
        if not local:
            if "ACM" in device:
                drop_carrier(fd)
            mode[2] &= ~termios.CLOCAL
            termios.tcsetattr(fd, termios.TCSANOW, mode)
    except OSError as error:
        raise termios.error(*error.args) from None
    finally:
        os.close(fd)


def fresh(device, local=True):
    """The line as each driver finds it: the kernel keeps what the last one made. One without CLOCAL may hang up meanwhile."""
    def made():
        try:
            make_fresh(device, local)
        except termios.error:
            return False
        return True

    until(made, f"{device} is not to be had")


def bare(words, user=None, between=None):
    """What a driver says without Porttape."""
    with subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, user=user,
                          group=user, extra_groups=None if user is None else []) as process:
        if between:
            between(process)
        said, told = process.communicate(timeout=6 * PATIENCE)
    need(process.returncode == 0, f"bare, the driver ended with {process.returncode}: {said[-700:]} {told[-900:]}")
    return said


def on(device, words):
    return [word.replace("{port}", device) for word in words]


def tapped(folder, device, steps, user=None):
    """What the driver says under `--tap`, and the tape."""
    tape = folder / "tape"
    said, told = supervised(folder, ["--tap", "--device", device, "--tape", str(tape)], steps, user)
    need_sound(tape)
    return said, told, tape


def passed(tape):
    """Of a tape, in order: runs of bytes, line by line ("w hello"), and what the driver made of its line ("7 even", "dtr off")."""
    rows, pending = [], {"w": b"", "r": b""}
    for line in command(PORTTAPE, "cat", "--json", str(tape)).splitlines():
        row = json.loads(line)
        if "event" not in row:
            way = row["dir"]
            *lines, pending[way] = (pending[way] + bytes.fromhex(row["hex"])).split(b"\n")
            rows += [f"{way} {one.decode()}" for one in lines]
        elif row["event"] == "drain":
            rows.append("drain")
        elif row.get("by") != "driver":
            continue
        elif row["event"] == "settings":
            rows.append(f"{row.get('databits')} {row.get('parity')}")
        elif row["event"] in ("modem", "break"):
            rows.append(f"{row.get('line', 'break')} {row['state']}")
    return rows


def need_taped(tape, breaks=True):
    written, read = (tapefile.payload(f"{tape}.log{way}") for way in "wr")
    need(written == WRITTEN and read == WRITTEN.swapcase(), f"on the tape: {len(written)} bytes written, {len(read)} read: "
                                                            f"{written[:60]!r} {read[:60]!r}")
    wanted = [one for one in PASSED if breaks or not one.startswith("break")]
    got = passed(tape)
    need(contains_in_order(got, wanted), f"on the tape: {got}")
    need(breaks or not any(one.startswith("break") for one in got), "a break that the device has not is on the tape")
    need(all(one.endswith(" exact") for one in taped_of_driver(tape) if " " in one and one[0].isdigit()), "settings are not exact")


class Told:
    """What the USB devices were told since."""

    def __init__(self):
        self.at = len(wire.modem), len(wire.settings), len(wire.ftdi)

    def all(self):
        modem, settings, ftdi = self.at
        return wire.modem[modem:], wire.settings[settings:], wire.ftdi[ftdi:]


def down(told):
    """Whether the device was told of the line's end last."""
    modem, _, ftdi = told
    return modem[-1:] == [0] or ftdi[-2:] == [("dtr", False), ("rts", False)]


def tap(folder, device, end, user, is_over=down):
    """All steps, bare and under `--tap`: the same is said, and told to the device. The tape, and what that was."""
    if user is not None:
        os.chmod(device, 0o666)
        folder.chmod(0o777)
    mark, told = folder / "mark", []
    with far(end):
        for run in ("bare", "tapped"):
            since = Told()
            fresh(device)
            until(lambda: is_over(since.all()), lambda: f"the device is left as {since.all()}")
            since = Told()
            if run == "bare":
                wanted = bare(on(device, driver(mark, STEPS)), user)
            else:
                said, warned, tape = tapped(folder, device, STEPS, user)
            until(lambda: is_over(since.all()), lambda: f"the device is left as {since.all()}")
            told.append(since.all())
    same(said, wanted, "the driver said")
    same(told[1], told[0], "the device was told")
    need("not on the tape" not in warned, warned)
    return tape, told[1], said


def tap_acm(folder, user=None):
    tape, (modem, settings, _), said = tap(folder, "/dev/ttyACM0", "/dev/ttyGS0", user)
    need(contains_in_order(modem, [3, 2, 3, 1, 3, 0]), f"the device was told the modem lines {modem}")
    need(contains_in_order(settings, [(9600, 1, "e", 7), (9600, 1, "o", 8)]), f"the device was told the settings {settings}")
    need_taped(tape, breaks=False)
    replayed(folder, tape, STEPS, replay_of(said), user)
    return "said and told to the device as bare: DTR, RTS, 7E1, 8O1; tape exact, in its order; replayed the same"


def replay_of(said):
    """A tape's line has all that a driver can make."""
    need(said.count("\n") == REPLAYED.count("\n"), f"the driver said {said!r}")
    return REPLAYED


def tap_ftdi(folder, user=None):
    tape, (_, _, ftdi), said = tap(folder, "/dev/ttyUSB0", "/dev/ttyS3", user)
    need_ftdi(ftdi)
    need_taped(tape)
    replayed(folder, tape, STEPS, replay_of(said), user)
    return "said and told to the adapter as bare: DTR, RTS, 7E1, 8O1, break; tape exact, in its order; replayed the same"


def tap_uart(folder, user=None):
    tape, _, said = tap(folder, "/dev/ttyS1", "/dev/ttyS2", user, lambda told: True)
    need_taped(tape)
    replayed(folder, tape, STEPS, replay_of(said), user)
    return "a 16550A says as bare: DTR, RTS, 7E1, 8O1, break; tape exact, in its order; replayed the same"


def check_tap_acm(folder):
    return tap_acm(folder)


def check_tap_ftdi(folder):
    return tap_ftdi(folder)


def check_tap_uart(folder):
    return tap_uart(folder)


def check_tap_acm_user(folder):
    return tap_acm(folder, USER)


def check_tap_ftdi_user(folder):
    return tap_ftdi(folder, USER)


def check_tap_uart_user(folder):
    return tap_uart(folder, USER)


def check_tap_loop(folder):
    """Modem lines reach a UART and come back from it."""
    with looped("/dev/ttyS1"):
        wanted = bare(on("/dev/ttyS1", driver(folder / "mark", ["loop"])))
        said, _, tape = tapped(folder, "/dev/ttyS1", ["loop"])
    same(said, wanted, "the driver said")
    told = [f"{event['line']} {event['state']} {event['by']}" for event in events(tape, "modem")]
    order = [f"{line} {state} {by}" for state in ("off", "on") for line, by in (("rts", "driver"), ("cts", "device"))] * 2
    need(contains_in_order(told, order), f"on the tape: {told}")
    # The kernel's own counters stand still in this mode.
    same(supervised(folder, ["--tape", str(tape)], ["loop"])[0].split(",")[0], said.split(",")[0], "under the replay it said")
    return "8250 in loop: the driver's RTS and the CTS that it is are on the tape in turn; replayed the same"


def opening(folder, device, how):
    return [PYTHON, "-B", str(HERE / "opening_driver.py"), device, str(folder / "mark"), how]


def opened_by_tap(folder, device, how, said):
    """The driver opens under `--tap` as it does bare; its tape."""
    tape = folder / how
    got = command(PORTTAPE, "exec", "--tap", "--device", device, "--tape", str(tape), "--", *opening(folder, device, how))
    need(got.startswith(said), f"{how}: the driver said {got!r}, not {said!r}")
    return tape


class LateCarrier(contextlib.AbstractContextManager):
    """Of ttyS1: DCD is off, and on once `mark` is there. In loop DCD is OUT2; the end of that is this open's end, too."""

    def __init__(self, mark):
        self.mark, self.over = mark, False
        self.fd = os.open("/dev/ttyS1", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        fcntl.ioctl(self.fd, termios.TIOCMBIS, struct.pack("i", TIOCM_LOOP))
        fcntl.ioctl(self.fd, termios.TIOCMBIC, struct.pack("i", TIOCM_OUT2))
        self.thread = threading.Thread(target=self.run, daemon=True)

    def run(self):
        until(lambda: self.over or self.mark.exists(), "the driver does not come to its open")
        if not self.over:
            threading.Event().wait(0.5)  # a wait that is to last
        pathlib.Path(f"{self.mark}.carrier").touch()
        fcntl.ioctl(self.fd, termios.TIOCMBIC, struct.pack("i", TIOCM_LOOP))
        fcntl.ioctl(self.fd, termios.TIOCMBIS, struct.pack("i", TIOCM_OUT2))
        os.close(self.fd)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.over = True
        self.thread.join(PATIENCE)


def check_tap_carrier(folder):
    """An open that waits for its carrier: it comes, or a signal does."""
    mark, said = folder / "mark", {}
    for how in ("waits", "breaks", "restarts"):
        for run in ("bare", "tap"):
            for left in (mark, pathlib.Path(f"{mark}.carrier")):
                left.unlink(missing_ok=True)
            fresh("/dev/ttyS1", local=False)
            with far("/dev/ttyS2"), LateCarrier(mark):
                if run == "bare":
                    said[how] = bare(opening(folder, "/dev/ttyS1", how))
                else:
                    tape = opened_by_tap(folder, "/dev/ttyS1", how, said[how])
        if how != "breaks":
            same(said[how], "open: with the carrier\nanswered\n", f"{how}: the driver said")
            need_sound(tape)
            same(tapefile.payload(f"{tape}.logw"), b"Here\n", f"{how}: written")
            same(tapefile.payload(f"{tape}.logr"), b"hERE\n", f"{how}: read")
    same(said["breaks"], "open: EINTR\n", "the driver that a signal breaks off said")
    need(not pathlib.Path(f"{folder / 'breaks'}.logw").exists(), "there is a tape of a device that was not opened")
    fresh("/dev/ttyS1")
    return "an open without O_NONBLOCK and CLOCAL waits for DCD, ends by a signal with EINTR, goes on with SA_RESTART: as bare"


def check_tap_no_carrier(folder):
    """A device that has DCD and whose driver in the kernel waits for none."""
    fresh("/dev/ttyACM0", local=False)
    said = bare(opening(folder, "/dev/ttyACM0", "opens"))
    fresh("/dev/ttyACM0", local=False)
    opened_by_tap(folder, "/dev/ttyACM0", "opens", said)
    fresh("/dev/ttyACM0")
    same(said, "open: at once\n", "the driver said")
    return "ttyACM0 without a carrier opens at once, as bare"


def unplugs(mark):
    def between(process):
        until(lambda: mark.exists() or process.poll() is not None, "the driver does not come to its read")
        threading.Event().wait(0.5)  # it waits in it
        unplug()
    return between


def check_tap_unplug(folder):
    """The device is unplugged under a read that waits."""
    tape, mark, steps = folder / "tape", folder / "mark", ["say=hello", "unplugged"]
    with far("/dev/ttyGS0"):
        fresh("/dev/ttyACM0")
        wanted = bare(on("/dev/ttyACM0", driver(mark, steps)), between=unplugs(mark))
    need(plug() == "/dev/ttyACM0", "the device came back as another")
    mark.unlink()
    words = [PORTTAPE, "exec", "--tap", "--device", "/dev/ttyACM0", "--tape", str(tape), "--", *driver(mark, steps)]
    with far("/dev/ttyGS0"):
        fresh("/dev/ttyACM0")
        with subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            unplugs(mark)(process)
            said, told = process.communicate(timeout=4 * PATIENCE)
    plug()
    same(said, wanted, f"({told}) the driver said")
    same(process.returncode, 6, f"({told}) exec's status")
    need(len(events(tape, "device-lost")) == 1, f"no device-lost on the tape: {told}")
    need("/dev/ttyACM0: the line hung up" in told, f"not told that it is lost: {told}")
    same(tapefile.payload(f"{tape}.logw"), b"hello\n", "written")
    same(tapefile.payload(f"{tape}.logr"), b"HELLO\n", "read")
    return f"as bare ({said.split('unplugged: ')[1].strip()}); device-lost on the tape, told, status 6"


def check_tap_kernel(folder):
    """What 6.1 lacks costs time and nothing else; the help says so."""
    with far("/dev/ttyGS0"):
        fresh("/dev/ttyACM0")
        said, told, _ = tapped(folder, "/dev/ttyACM0", ["cost", "say=hello"])
    need("/dev/ttyACM0" not in told and "lack" not in told, f"exec told: {told}")
    need("Linux 6.6" in command(PORTTAPE, "exec", "--help"), "the help does not say what Linux before 6.6 lacks")
    return f"Linux {os.uname().release}: {said.splitlines()[1]} trapped and not (emulated)"
