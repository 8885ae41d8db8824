#!/usr/bin/python3
"""driver.py PORT RATE…: at each rate in turn, says three lines on PORT and wants the answer to each.

A rate is BAUD or BAUD/2 (stop bits). The answer is the line with small letters for capitals, and the other way round.
"""

import fcntl
import os
import select
import struct
import sys
import termios
import tty

TCGETS2, TCSETSW2, BOTHER, CBAUD = 0x802C542A, 0x402C542C, 0o010000, 0o010017
TERMIOS2 = "4IB19s2I"


class Port:
    """A raw tty with any rate. Owns its descriptor."""

    def __init__(self, path):
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd)

    def close(self):
        os.close(self.fd)

    def set(self, baud, stopbits=1):
        words = list(struct.unpack(TERMIOS2, fcntl.ioctl(self.fd, TCGETS2, bytes(44))))
        words[2] = words[2] & ~(CBAUD | CBAUD << 16 | termios.CSTOPB) | (BOTHER if baud else 0)
        words[2] |= termios.CSTOPB if stopbits == 2 else 0
        words[6] = words[7] = baud
        fcntl.ioctl(self.fd, TCSETSW2, struct.pack(TERMIOS2, *words))

    def baud(self):
        return struct.unpack(TERMIOS2, fcntl.ioctl(self.fd, TCGETS2, bytes(44)))[-1]

    def write(self, data):
        os.write(self.fd, data)

    def read(self, seconds):
        """What is there within so long, b"" at a hang-up; TimeoutError."""
        if not select.select([self.fd], [], [], seconds)[0]:
            raise TimeoutError("nothing came")
        try:
            return os.read(self.fd, 4096)
        except OSError:
            return b""

    def exchange(self, message, seconds=30):
        """Writes a line, and reads its answer."""
        self.write(message + b"\n")
        got = b""
        while not got.endswith(b"\n"):
            more = self.read(seconds)
            if not more:
                raise EOFError(f"the line hung up after {got!r}")
            got += more
        if got != message.swapcase() + b"\n":
            raise ValueError(f"wrote {message!r}, got {got!r}")


def main(path, rates):
    port = Port(path)
    for rate in rates:
        baud, _, stopbits = rate.partition("/")
        port.set(int(baud), int(stopbits or 1))
        for number in range(3):
            port.exchange(b"%s, line %d" % (rate.encode(), number))
    port.close()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
