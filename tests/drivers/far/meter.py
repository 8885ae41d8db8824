"""A multimeter with Cyrustek's ES51922, as the UNI-T UT61E: it speaks twice a second without being asked, 14 bytes at
19200 7O1, and has its current from the port: RTS off and DTR on. Each time that it is switched on it counts from the
first of its readings."""

import time

from far.quiet import Quiet

PACKET_SECONDS = 0.5
VOLTS = ord(";")
DC, AUTO = 0x08, 0x02


def packet(digits):
    """So many volts, in the range of 2.2."""
    return b"0" + digits.encode() + bytes((VOLTS, 0x30, 0x30, 0x30, 0x30 | DC | AUTO, 0x30)) + b"\r\n"


class Meter(Quiet):
    def __init__(self, rate=19200):
        super().__init__(rate)
        self._next = None
        self._count = 0

    def opened(self, line):
        self._next = time.monotonic() + PACKET_SECONDS
        self._count = 0

    def closed(self):
        self._next = None

    def due(self):
        return self._next

    def tick(self, line):
        self._count += 1
        self._next += PACKET_SECONDS
        line.send(packet(f"{12340 + self._count:05d}"))
