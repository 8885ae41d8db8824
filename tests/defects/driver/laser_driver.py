#!/usr/bin/python3
"""A stand-in laser driver: turns the laser on, takes two scans, turns it off. Reads no more than it needs.

Requests are `COMMAND;XX` and a line feed; XX is the XOR of the bytes before the semicolon, in hex. An answer is the
request's command, a status, what the command gives, and an empty line. A scan is `SIZE N` and N bytes. Exit status 1: something
was wrong.
"""

import os
import select
import sys
import termios
import time
import tty

TIMEOUT = 2.0  # seconds, for each answer


def checksum(command):
    value = 0
    for byte in command:
        value ^= byte
    return b"%02X" % value


class Laser:
    """The line to the laser, and its answers."""

    def __init__(self, path):
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd, termios.TCSANOW)
        self.limit = 0.0

    def close(self):
        os.close(self.fd)

    def send(self, command):
        os.write(self.fd, command + b";" + checksum(command) + b"\n")

    def read(self, size):
        ready = select.select([self.fd], [], [], max(0, self.limit - time.monotonic()))[0]
        data = os.read(self.fd, size) if ready else b""
        if not data:
            raise OSError("no answer")
        return data

    def read_line(self):
        line = b""
        while not line.endswith(b"\n"):
            line += self.read(1)
        return line[:-1]

    def read_bytes(self, size):
        data = b""
        while len(data) < size:
            data += self.read(size - len(data))
        return data

    def read_answer(self, command):
        self.limit = time.monotonic() + TIMEOUT
        echo, status = self.read_line(), self.read_line()
        if echo != command or status != b"00":
            raise ValueError(f"{command!r} is answered by {echo!r}, {status!r}")
        lines = []
        while line := self.read_line():
            if line.startswith(b"SIZE "):
                lines.append(self.read_bytes(int(line[5:])))
                self.read_line()
            else:
                lines.append(line)
        return lines

    def ask(self, command):
        self.send(command)
        return self.read_answer(command)


def scan(laser, first, last):
    (data,) = laser.ask(b"GD%04d%04d" % (first, last))
    ranges = [2 * byte for byte in data]
    if len(ranges) != last - first + 1:
        raise ValueError(f"{len(ranges)} ranges instead of {last - first + 1}")
    print(f"{len(ranges)} ranges, nearest {min(ranges)} mm")


def main():
    laser = Laser(sys.argv[1])
    version = laser.ask(b"VV")
    parameters = laser.ask(b"PP")
    print(version[0].decode(), parameters[0].decode())
    laser.ask(b"II")
    laser.ask(b"BM")
    scan(laser, 44, 725)
    scan(laser, 384, 431)
    laser.ask(b"QT")
    laser.close()


if __name__ == "__main__":
    try:
        main()
    except (OSError, ValueError) as error:
        sys.exit(f"laser_driver: {error}")
