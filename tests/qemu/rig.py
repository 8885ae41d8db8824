"""What the checks of the guest stand on: programs that answer, the wire between both ends, plugs, the daemon."""

import contextlib
import fcntl
import json
import os
import pathlib
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
import tty

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from driver import Port  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent
PYTHON = "/usr/bin/python3"
BUSYBOX = "/run/bin/busybox"
BY_ID = pathlib.Path("/run/serial/by-id")
WORDS = dict(word.partition("=")[::2] for word in pathlib.Path("/proc/cmdline").read_text().split())
BY_ID_DEVICE = f"serial:{BY_ID}/usb-porttape-gadget,baud=57600,alwaysopen,wait"
PATIENCE = int(WORDS.get("porttape.patience", 60))  # seconds, for what comes in one on a real machine
PORTTAPED = WORDS["porttape.build"] + "/daemon/porttaped"
PORTTAPE = WORDS["porttape.build"] + "/tools/porttape"


class Wrong(Exception):
    """Not as it should be."""


def say(text):
    os.write(1, ("\x1e" + " ".join(text.split()) + "\n").encode())


def need(true, told):
    if not true:
        raise Wrong(told)


def until(true, told):
    deadline = time.monotonic() + PATIENCE
    while not (value := true()):
        need(time.monotonic() < deadline, f"{told() if callable(told) else told} (waited {PATIENCE} s)")
        time.sleep(0.02)
    return value


# ---- the far end, and what passes on the wire

# Clear while the gadget goes: Debian's u_serial falls over a tty that is opened then.
plugged = threading.Event()


class FarEnd:
    """Answers on a tty; opens it again when it hung up. Threads: one of its own, until `stop`."""

    def __init__(self, path, answer):
        self.path, self.answer, self.stopping, self.fd = path, answer, False, None
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()
        until(lambda: self.fd is not None, f"{path} does not open")

    def run(self):
        while not self.stopping:
            plugged.wait()
            try:
                fd = os.open(self.path, os.O_RDWR | os.O_NOCTTY)
            except OSError:
                time.sleep(0.05)
                continue
            with contextlib.suppress(OSError, termios.error):
                tty.setraw(fd)
                termios.tcflush(fd, termios.TCIOFLUSH)
                self.fd = fd
                while not self.stopping:
                    self.answer_some(fd)
            self.fd = None
            os.close(fd)

    def answer_some(self, fd):
        if not select.select([fd], [], [], 0.1)[0]:
            return
        data = os.read(fd, 4096)
        if not data:
            raise OSError("hung up")
        os.write(fd, self.answer(data))

    def stop(self):
        self.stopping = True
        self.thread.join(PATIENCE)


def ftdi_told(request, value):
    """What FTDI's requests 1 (modem control) and 4 (set data) say."""
    if request == "01":
        return [(name, bool(value & bit)) for name, bit in (("dtr", 1), ("rts", 2)) if value >> 8 & bit]
    return [("data", value & 0xFF, "noems"[value >> 8 & 7], {0: 1, 2: 2}.get(value >> 11 & 3), bool(value & 0x4000))]


class Wire:
    """What the host tells the USB devices of their line.

    The gadget: [(baud, stop bits, parity, data bits)] and the states of DTR (1) and RTS (2). The FTDI adapter, of what it
    took: ("dtr", on), ("rts", on), ("data", data bits, parity, stop bits, break).
    """

    def __init__(self):
        self.settings, self.modem, self.ftdi, self.asked = [], [], [], {}
        self.file = open("/sys/kernel/debug/usb/usbmon/0u", "rb", buffering=0)
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        for line in self.file:
            text = line.decode()
            if coding := re.search(r" S Co:\S+ s 21 20 \S+ \S+ 0007 7 = (\w{8}) (\w{6})", text):
                baud, = struct.unpack("<I", bytes.fromhex(coding[1]))
                stop, parity, data = bytes.fromhex(coding[2])
                self.settings.append((baud, {0: 1, 2: 2}.get(stop), "noems"[parity], data))
            elif state := re.search(r" S Co:\S+ s 21 22 (\w{4}) ", text):
                self.modem.append(int(state[1], 16))
            elif asked := re.match(r"(\w+) \d+ S Co:\S+ s 40 (01|04) (\w{4}) ", text):
                self.asked[asked[1]] = (asked[2], int(asked[3], 16))
            elif (took := re.match(r"(\w+) \d+ C Co:\S+ (-?\d+) ", text)) and took[1] in self.asked:
                request, value = self.asked.pop(took[1])
                if took[2] == "0":
                    self.ftdi += ftdi_told(request, value)

    def rates(self):
        """Without repetitions."""
        return [now[0] for before, now in zip([None, *self.settings], self.settings) if before is None or now[0] != before[0]]


wire = Wire()


# ---- plugging, as udev would see it


def acm_tty():
    """The name of the tty that the gadget has now, or None."""
    found = [path.name for path in pathlib.Path("/sys/class/tty").glob("ttyACM*") if os.path.exists(path / "device")]
    return found[0] if found else None


def link_by_id():
    """Makes or removes the link to the gadget's tty, with its folder."""
    link, now = BY_ID / "usb-porttape-gadget", acm_tty()
    if now:
        BY_ID.mkdir(parents=True, exist_ok=True)
        (BY_ID / ".new").symlink_to(f"/dev/{now}")
        (BY_ID / ".new").rename(link)
    elif BY_ID.exists():
        link.unlink(missing_ok=True)
        BY_ID.rmdir()
        BY_ID.parent.rmdir()


def unplug():
    plugged.clear()
    subprocess.run([BUSYBOX, "rmmod", "g_serial"], check=True, timeout=PATIENCE)  # waits until ttyGS0 is closed
    until(lambda: acm_tty() is None, "the gadget's tty does not go")
    link_by_id()


def plug():
    if acm_tty() is None:
        subprocess.run([BUSYBOX, "insmod", "/run/modules/g_serial.ko"], check=True, timeout=PATIENCE)
        until(lambda: acm_tty() and os.path.exists(f"/dev/{acm_tty()}"), "the gadget's tty does not come")
    plugged.set()
    link_by_id()
    return f"/dev/{acm_tty()}"


# ---- the daemon


class Daemon:
    """porttaped until `stop`."""

    def __init__(self, folder, *words, wait_for=None):
        self.log = folder / "porttaped.log"
        self.process = subprocess.Popen([PORTTAPED, *words, "--log-file", str(self.log)], stdin=subprocess.DEVNULL)
        if wait_for:
            until(lambda: wait_for.exists() or self.process.poll() is not None, lambda: "porttaped: " + self.text())
            self.need_alive()

    def text(self):
        return self.log.read_text() if self.log.exists() else ""

    def need_alive(self):
        need(self.process.poll() is None, f"porttaped ended with {self.process.returncode}: {self.text()}")

    def logged(self, pattern):
        return re.findall(pattern, self.text())

    def stop(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        try:
            return self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise Wrong("porttaped did not end on SIGTERM: " + self.text()) from None


@contextlib.contextmanager
def bridge(folder, device, *words, tape=None):
    """A daemon between `device` and folder/port."""
    verb = ["record", "--tape", str(tape)] if tape else ["bridge"]
    daemon = Daemon(folder, *verb, "--device", device, "--driver", f"pty:{folder}/port", *words, wait_for=folder / "port")
    try:
        yield daemon
    finally:
        daemon.stop()


@contextlib.contextmanager
def opened(path):
    port = Port(str(path))
    try:
        yield port
    finally:
        port.close()


@contextlib.contextmanager
def far(path, answer=bytes.swapcase):
    end = FarEnd(path, answer)
    try:
        yield end
    finally:
        end.stop()


def command(*words, status=0):
    done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=4 * PATIENCE, check=False)
    need(done.returncode == status, f"{pathlib.Path(words[0]).name} {words[1]}: status {done.returncode}, not {status}: "
                                    f"{done.stdout[-600:]} {done.stderr[-600:]}")
    return done.stdout + done.stderr


def need_sound(tape):
    told = command(PORTTAPE, "verify", str(tape))
    need(": sound" in told, f"the tape is not sound: {told}")


def events(tape, kind):
    lines = pathlib.Path(f"{tape}.loge").read_text().splitlines()
    return [event for event in map(json.loads, lines) if event.get("event") == kind]


def line_of(path):
    """(baud, databits, parity, stopbits) of a tty that somebody else has open. Root may open it in spite of TIOCEXCL."""
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        words = struct.unpack("4IB19s2I", fcntl.ioctl(fd, 0x802C542A, bytes(44)))
    finally:
        os.close(fd)
    flags = words[2]
    bits = {termios.CS5: 5, termios.CS6: 6, termios.CS7: 7, termios.CS8: 8}[flags & termios.CSIZE]
    parity = "none" if not flags & termios.PARENB else "odd" if flags & termios.PARODD else "even"
    return words[-1], bits, parity, 2 if flags & termios.CSTOPB else 1


def modem_of(number):
    """(DTR, RTS) of ttyS<number>. Another open would raise them."""
    text = pathlib.Path("/proc/tty/driver/serial").read_text()
    lines = re.search(rf"^{number}: .*?([A-Z|]*)$", text, re.M)[1].split("|")
    return "DTR" in lines, "RTS" in lines


def contains_in_order(whole, part):
    rest = iter(whole)
    return all(one in rest for one in part)
