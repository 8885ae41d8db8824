"""`porttape exec` on real ttys: what a supervised driver does to its line reaches the device, and is on the tape in its place.

The far side is what passes on USB (`wire`): what the device was told of DTR, RTS, breaks, parity and data bits. Of the FTDI adapter
qemu plays the hardware. `supervised()` is where the verb's line is made.
"""

import contextlib
import fcntl
import json
import os
import pathlib
import re
import select
import struct
import subprocess
import termios

from rig import (HERE, PATIENCE, PORTTAPE, PYTHON, FarEnd, command, contains_in_order, events, far, need, need_sound, plug,
                 unplug, until, wire)

USER = os.stat(PORTTAPE).st_uid or 65534  # one who may read the build
TIOCM_LOOP = 0x8000
DRIVER = HERE / "line_driver.py"

STEPS = ["say=hello", "dtr=off", "dtr=on", "rts=off", "rts=on", "frame=7E1", "frame=8O1", "drain", "serial", "rs485", "break",
         "say=bye"]
SAID = """\
open: dtr on rts on
say=hello: answered
dtr=off: dtr off rts on
dtr=on: dtr on rts on
rts=off: dtr on rts off
rts=on: dtr on rts on
frame=7E1: kept
frame=8O1: kept
drain: 501 bytes
serial: low latency
rs485: error 25
break: sent
say=bye: answered
"""
# cdc_acm keeps no such flag.
SAID_BY_ACM = SAID.replace("serial: low latency", "serial: not low latency")
# A tape has neither: the driver is given back what it made.
REPLAYED = SAID.replace("rs485: error 25", "rs485: on")
# What of it is on the tape, in this order.
TAPED = ["dtr off", "dtr on", "rts off", "rts on", "7 even exact", "8 odd exact", "break on", "break off"]


def driver(mark, steps):
    return [PYTHON, "-B", str(DRIVER), "{port}", str(mark), *steps]


def supervised(folder, where, steps, user=None, status=0):
    """What the driver says under `porttape exec`, and what the latter does."""
    done = subprocess.run([PORTTAPE, "exec", *where, "--", *driver(folder / "mark", steps)], stdin=subprocess.DEVNULL,
                          capture_output=True, text=True, timeout=6 * PATIENCE, check=False, user=user, group=user,
                          extra_groups=None if user is None else [])
    need(done.returncode == status, f"exec {where}: status {done.returncode}, not {status}: {done.stdout[-700:]} "
                                    f"{done.stderr[-900:]}")
    return done.stdout, done.stderr


def same(got, wanted, what):
    need(got == wanted, f"{what}: {got!r}, not {wanted!r}")


def taped_of_driver(tape):
    """Settings, modem lines and breaks of the driver's, in their order."""
    told = []
    for line in pathlib.Path(f"{tape}.loge").read_text().splitlines():
        event = json.loads(line)
        if event.get("by") != "driver":
            continue
        if event["event"] == "settings":
            told.append(f"{event.get('databits')} {event.get('parity')} {event.get('order')}")
        elif event["event"] == "modem":
            told.append(f"{event['line']} {event['state']}")
        elif event["event"] == "break":
            told.append(f"break {event['state']}")
    return told


def replayed(folder, tape, steps, said, user=None):
    """The tape in the device's place: the driver says the same, and makes the same of its line."""
    (folder / "mark").unlink(missing_ok=True)
    same(supervised(folder, ["--tape", str(tape)], steps, user)[0], said, "under the replay it said")
    (folder / "mark").unlink(missing_ok=True)
    command(PORTTAPE, "test", "--exec", "--check-settings", "--tape", str(tape), "--", *driver(folder / "mark", steps))


def recorded(folder, device, wanted, user=None):
    """Records all steps on `device`, where the driver says what is wanted; the tape, and what exec warned of."""
    tape = folder / "tape"
    if user is not None:
        os.chmod(device, 0o666)
        folder.chmod(0o777)
    said, told = supervised(folder, ["--device", f"{device},baud=57600", "--tape", str(tape)], STEPS, user)
    same(said, wanted, "the driver said")
    need_sound(tape)
    got = taped_of_driver(tape)
    need(contains_in_order(got, TAPED), f"on the tape: {got}")
    return tape, told


def need_acm(modem, settings):
    need(contains_in_order(modem, [3, 2, 3, 1, 3, 0]), f"the device was told the modem lines {modem}")
    wanted = [(9600, 1, "e", 7), (9600, 1, "o", 8), (57600, 1, "n", 8)]  # the last is what it had before
    need(contains_in_order(settings, wanted), f"the device was told the settings {settings}")


def need_ftdi(told):
    wanted = [("dtr", True), ("dtr", False), ("dtr", True), ("rts", False), ("rts", True)]
    need(contains_in_order([one for one in told if one[0] != "data"], wanted), f"the adapter was told {told}")
    wanted = [("data", 7, "e", 1, False), ("data", 8, "o", 1, False), ("data", 8, "o", 1, True), ("data", 8, "o", 1, False)]
    need(contains_in_order(told, wanted), f"the adapter was told {told}")


def exec_acm(folder, user=None):
    modem, settings = len(wire.modem), len(wire.settings)
    with far("/dev/ttyGS0"):
        tape, told = recorded(folder, "/dev/ttyACM0", SAID_BY_ACM, user)
        until(lambda: wire.modem[-1:] == [0], lambda: f"DTR is left up: {wire.modem[modem:]}")
    need_acm(wire.modem[modem:], wire.settings[settings:])
    need("the device has no breaks" in told, f"it is not told that the device has no breaks: {told}")
    replayed(folder, tape, STEPS, REPLAYED, user)
    return "USB device told DTR and RTS off and on, 7E1, 8O1; that it has no breaks is told; tape exact; replayed the same"


def exec_ftdi(folder, user=None):
    begin = len(wire.ftdi)
    with far("/dev/ttyS3"):
        tape, _ = recorded(folder, "/dev/ttyUSB0", SAID, user)
    need_ftdi(wire.ftdi[begin:])
    replayed(folder, tape, STEPS, REPLAYED, user)
    return "adapter told DTR and RTS off and on, 7E1, 8O1, break; tape exact; replayed the same"


def check_exec_acm(folder):
    return exec_acm(folder)


def check_exec_ftdi(folder):
    return exec_ftdi(folder)


def check_exec_acm_user(folder):
    return exec_acm(folder, USER)


def check_exec_ftdi_user(folder):
    return exec_ftdi(folder, USER)


def check_exec_bridge(folder):
    """Without a tape."""
    modem, settings = len(wire.modem), len(wire.settings)
    with far("/dev/ttyGS0"):
        same(supervised(folder, ["--device", "/dev/ttyACM0,baud=57600"], STEPS)[0], SAID_BY_ACM, "the driver said")
    need_acm(wire.modem[modem:], wire.settings[settings:])
    return "the same without a tape"


class BlinkingFarEnd(FarEnd):
    """Once it was sent `carrier` its carrier goes off and on until `mark` is there; then it sends a break, and a line."""

    def __init__(self, path, mark):
        self.mark, self.blinks = mark, False
        super().__init__(path, bytes.swapcase)

    def answer_some(self, fd):
        if self.blinks and self.mark.exists():
            self.blinks = False
            termios.tcsendbreak(fd, 0)
            os.write(fd, b"there\n")
        if self.blinks:
            select.select([], [], [], 0.3)
            raise OSError("its carrier goes off")  # the last close of ttyGS0 tells the other side so
        if not select.select([fd], [], [], 0.1)[0]:
            return
        data = os.read(fd, 4096)
        if not data:
            raise OSError("hung up")
        self.blinks = b"carrier" in data
        if not self.blinks:
            os.write(fd, self.answer(data))


def check_exec_carrier(folder):
    """What the device does: a carrier that ends TIOCMIWAIT, a break, their counters."""
    tape, steps = folder / "tape", ["say=hello", "carrier", "say=bye", "counters"]
    said = "open: dtr on rts on\nsay=hello: answered\ncarrier: there\nsay=bye: answered\ncounters: carrier counted, break counted\n"
    end = BlinkingFarEnd("/dev/ttyGS0", folder / "mark")
    try:
        same(supervised(folder, ["--device", "/dev/ttyACM0,baud=57600", "--tape", str(tape)], steps)[0], said, "the driver said")
    finally:
        end.stop()
    need_sound(tape)
    got = [f"{event['line']} {event['state']}" for event in events(tape, "modem") if event.get("by") == "device"]
    need(contains_in_order(got, ["cd off", "cd on"]), f"the device's lines on the tape: {got}")
    need(any(event.get("by") == "device" for event in events(tape, "break")), "the device's break is not on the tape")
    replayed(folder, tape, steps, said)
    return f"the far end's carrier ended TIOCMIWAIT, {got.count('cd off')} times off on the tape; its break was counted; replayed the same"


@contextlib.contextmanager
def looped(path):
    """A 16550A that is joined with itself: RTS leads to CTS in the UART."""
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        fcntl.ioctl(fd, termios.TIOCMBIS, struct.pack("i", TIOCM_LOOP))
        yield
        fcntl.ioctl(fd, termios.TIOCMBIC, struct.pack("i", TIOCM_LOOP))
    finally:
        os.close(fd)


def check_exec_loop(folder):
    """Modem lines reach a UART and come back from it."""
    tape, said = folder / "tape", "open: dtr on rts on\nloop: cts off on off on, counted 4\n"
    with looped("/dev/ttyS1"):
        same(supervised(folder, ["--device", "/dev/ttyS1,baud=19200", "--tape", str(tape)], ["loop"])[0], said, "the driver said")
    told = [f"{event['line']} {event['state']} {event['by']}" for event in events(tape, "modem")]
    wanted = [f"{line} {state} {by}" for state in ("off", "on") for line, by in (("rts", "driver"), ("cts", "device"))] * 2
    need(contains_in_order(told, wanted), f"on the tape: {told}")
    same(supervised(folder, ["--tape", str(tape)], ["loop"])[0], said, "under the replay it said")
    return "8250 in loop: the driver's RTS is its CTS, four changes seen and counted, on the tape in turn; replayed the same"


def check_exec_unplug(folder):
    """The device is unplugged under a driver that waits for bytes."""
    tape, mark, steps = folder / "tape", folder / "mark", ["say=hello", "hangup"]
    said = "open: dtr on rts on\nsay=hello: answered\nhangup: hung up\n"
    words = [PORTTAPE, "exec", "--device", "/dev/ttyACM0,baud=57600", "--tape", str(tape), "--", *driver(mark, steps)]
    with far("/dev/ttyGS0"), subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                              text=True) as process:
        until(lambda: mark.exists() or process.poll() is not None, "the driver does not come to its wait")
        unplug()
        got, told = process.communicate(timeout=4 * PATIENCE)
        plug()
    same(got, said, f"({told}) the driver said")
    same(process.returncode, 6, "exec's status")
    need(len(events(tape, "device-lost")) == 1, f"no device-lost on the tape: {told}")
    mark.unlink()
    same(supervised(folder, ["--tape", str(tape)], steps)[0], said, "under the replay it said")
    need("'/dev/ttyACM0' is lost" in told, f"not told that it is lost: {told}")
    return "the driver's line hung up, status 6, told; the tape hangs it up in the same place"


def check_exec_kernel(folder):
    """What 6.1 lacks costs time and nothing else; the help says so."""
    release = os.uname().release
    with far("/dev/ttyGS0"):
        said, told = supervised(folder, ["--device", "/dev/ttyACM0"], ["cost"])
    same(told, "", "exec told")
    need("Linux 6.6" in command(PORTTAPE, "exec", "--help"), "the help does not say what Linux before 6.6 lacks")
    trapped, bare = re.search(r"cost: (\d+) us, (\d+) us", said).groups()
    return f"Linux {release}: a trapped call {trapped} us, another {bare} us (emulated)"
