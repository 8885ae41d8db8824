"""gpsd's test logs: what gpsfake makes of one, and the tape of that.

gpsfake's own reader cuts a log into sentences and packets, takes its comments for what they are, and puts the line behind
it at which gpsd takes the device for ended. It is a module of Debian's Python, as this one then is.
"""

import pathlib
import sys

from gps import fake

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "devices"))
import tapefile  # noqa: E402  (the folder has no package)

SPEED = 38400  # with which regress-driver has gpsfake set up its pty


class Log:
    """One log: its `name`, its `transport` (pty, TCP or UDP), its `pieces` as they are sent, the `delay` between them."""

    def __init__(self, path):
        try:
            load = fake.TestLoad(str(path), oneshot=True)
        except fake.TestError as error:  # no Exception, but a BaseException
            raise ValueError(f"{path}: {error.msg}") from None
        self.path = path
        self.name = path.name
        self.transport = load.sourcetype
        self.delay = load.delay
        self.pieces = load.sentences
        self.chk = path.with_name(path.name + ".chk")

    def reads(self, pace_us):
        """[(microseconds, bytes)] as gpsfake sends them, at least so far apart."""
        at, found = pace_us, []
        for piece in self.pieces:
            at += int(piece.split()[1]) * 1_000_000 if b"%Delay:" in piece else 0
            if piece:
                found.append((at, piece))
            at += max(pace_us, round(self.delay * 1_000_000))
        return found

    def write_tape(self, name, pace_us):
        """The tape; returns how many microseconds it lasts."""
        reads = self.reads(pace_us)
        events = [(0, {"event": "open"})]
        if self.transport == "pty":
            events.append((0, {"event": "settings", "by": "device", "baud": SPEED, "databits": 8, "parity": "none",
                               "stopbits": 1, "hwflowctrl": False, "swflowctrl": False, "order": "exact"}))
        end = reads[-1][0] + 1  # at the same time the event would be first
        events += [(end, {"event": "close"}), (end, {"event": "end"})]
        tapefile.write(name, reads, events, "datagram" if self.transport == "UDP" else "stream")
        return end
