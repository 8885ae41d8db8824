"""The far end of a serial line: a pty whose slave stands for the device, and whose master is the device.

A device (the other files of this folder) is an object with

    rate             the rate it speaks at, or None: any. While the line has another, what passes either way is noise
    opened(line)     the first program opened the line: speak with line.send(bytes)
    received(line, data)
    due()            monotonic time of its next tick, or None
    tick(line)
    closed()         the last program has closed it
    end()            nothing more comes: end what it started

A FarEnd runs it in a thread of its own and keeps what an observer of the line could know: all bytes both ways, the
settings in their order, flushes, opens and closes.
"""

import errno
import fcntl
import os
import select
import struct
import termios
import threading
import time
from typing import NamedTuple

TCGETS2, TCSETS2 = 0x802C542A, 0x402C542B
TIOCPKT, TIOCSPTLCK, TIOCGPTN = 0x5420, 0x40045431, 0x80045430
BOTHER = 0o10000
FLUSH_READ, FLUSH_WRITE = 0x01, 0x02
TERMIOS2 = struct.Struct("4IB19s2I")
SAMPLE_SECONDS = 0.001


class Settings(NamedTuple):
    """What of a line's settings reaches the other end of a pty: all but parity and data bits."""

    baud: int
    stopbits: int
    hwflowctrl: bool
    swflowctrl: bool

    def __str__(self):
        flow = "".join(f" {name}" for name, on in (("rts/cts", self.hwflowctrl), ("xon/xoff", self.swflowctrl)) if on)
        return f"{self.baud} {self.stopbits} stop{flow}"


def settings_of(fd):
    buffer = bytearray(TERMIOS2.size)
    fcntl.ioctl(fd, TCGETS2, buffer)
    iflag, _, cflag, _, _, _, _, ospeed = TERMIOS2.unpack(buffer)
    xon_xoff = termios.IXON | termios.IXOFF
    return Settings(ospeed, 2 if cflag & termios.CSTOPB else 1, bool(cflag & termios.CRTSCTS),
                    iflag & xon_xoff == xon_xoff)


def set_raw(fd, baud):
    control = bytearray(19)
    control[termios.VMIN] = 1
    # Drivers look at it, and know no BOTHER.
    cflag = termios.CS8 | termios.CREAD | termios.CLOCAL | getattr(termios, f"B{baud}", BOTHER)
    fcntl.ioctl(fd, TCSETS2, TERMIOS2.pack(0, 0, cflag, 0, 0, bytes(control), baud, baud))


class Held(NamedTuple):
    """One entry of the settings' history: what the line had from `since` on, and how many bytes the driver had written."""

    settings: Settings
    since: float
    written: int


class FarEnd:
    """Owns the pty and the thread. start(), run a driver on `path`, wait_closed(), stop(); then read what it kept."""

    def __init__(self, device, baud):
        self.device = device
        self.received, self.sent = bytearray(), bytearray()
        self.sessions = []  # from each open to its close: [Held, …], the last one without settings, when it closed
        self.flushes = []  # "in" or "out"; several between two looks count as one
        self.error = None
        self.own = Settings(baud, 1, False, False)
        self._queue = bytearray()
        self._open = False
        self._stop = threading.Event()
        self._changed = threading.Condition()
        self._master = os.open("/dev/ptmx", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        fcntl.ioctl(self._master, TIOCSPTLCK, struct.pack("i", 0))
        number = struct.unpack("I", fcntl.ioctl(self._master, TIOCGPTN, bytes(4)))[0]
        self.path = f"/dev/pts/{number}"
        set_raw(self._master, baud)
        fcntl.ioctl(self._master, TIOCPKT, struct.pack("i", 1))
        os.chmod(self.path, 0o666)  # some drivers drop their privileges before they open it
        os.close(os.open(self.path, os.O_RDWR | os.O_NOCTTY))  # from here on a hang-up says that nobody has it open
        self._thread = threading.Thread(target=self._guard, daemon=True)

    def start(self):
        self._thread.start()

    def stop(self):
        self._stop.set()
        self._thread.join()
        os.close(self._master)

    def wait_closed(self, seconds):
        """Whether everybody has closed the line within so many seconds."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._open, seconds)

    def send(self, data):
        """For devices."""
        heard = data if self.understood() else noise(data)
        self.sent += heard
        self._queue += heard
        self._write()

    def understood(self):
        """For devices: whether the line has the device's rate."""
        rate = self.device.rate
        return rate is None or abs(settings_of(self._master).baud - rate) * 40 < rate

    def _guard(self):
        try:  # a device does not wait for this machine
            os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(1))
        except PermissionError:
            pass
        try:
            self._run()
        except Exception as error:  # the run that reads it fails
            self.error = error
            with self._changed:
                self._open = False
                self._changed.notify_all()

    def _run(self):
        poller = select.poll()
        poller.register(self._master, select.POLLIN | select.POLLPRI)
        while not self._stop.is_set():
            # Nothing tells of an open, nor of other settings: both are looked for.
            if not self._open:
                time.sleep(SAMPLE_SECONDS)
            events = poller.poll(SAMPLE_SECONDS * 1000)
            self._step(events[0][1] if events else 0)

    def _step(self, events):
        if not self._open:
            if events & select.POLLHUP:
                return
            self._begin()
        self._sample()
        self._read()
        self._sample()
        self._write()
        due = self.device.due()
        if due is not None and time.monotonic() >= due:
            self.device.tick(self)
        if events & select.POLLHUP and not events & (select.POLLIN | select.POLLPRI):
            self._end()

    def _begin(self):
        self.sessions.append([])
        self._open = True
        self.device.opened(self)

    def _end(self):
        self._queue.clear()
        self._note(None)
        self.device.closed()
        with self._changed:
            self._open = False
            self._changed.notify_all()

    def _sample(self):
        now = settings_of(self._master)
        history = self.sessions[-1]
        if not history or history[-1].settings != now:
            self._note(now)

    def _note(self, settings):
        self.sessions[-1].append(Held(settings, time.monotonic(), len(self.received)))

    def _read(self):
        while True:
            try:
                packet = os.read(self._master, 4096)
            except BlockingIOError:
                return
            except OSError as error:
                if error.errno == errno.EIO:
                    return
                raise
            if packet[0]:
                self._status(packet[0])
                continue
            data = packet[1:]
            self.received += data
            if self.understood():
                self.device.received(self, data)

    def _status(self, status):
        if status & FLUSH_READ:
            self._queue.clear()
        for bit, name in ((FLUSH_READ, "in"), (FLUSH_WRITE, "out")):
            if status & bit:
                self.flushes.append(name)

    def _write(self):
        try:
            while self._queue:
                del self._queue[:os.write(self._master, self._queue[:4096])]
        except BlockingIOError:
            pass


def noise(data):
    """What a receiver at another rate makes of it: as many bytes, never text."""
    return bytes(0x80 | (byte * 37 & 0x7F) for byte in data)
