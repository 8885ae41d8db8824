#!/usr/bin/python3
"""The laser for laser_driver.py, on a pty of its own: prints where it is, then answers until it is ended."""

import os
import sys
import time
import tty

LATENCY = {b"BM": 0.3, b"GD": 0.06}  # seconds; turning it on takes its time
LINES = {b"VV": [b"PROD:Stand-in laser"], b"PP": [b"STEPS:768", b"NEAR:20"], b"II": [b"LASER:OFF"], b"BM": [], b"QT": []}


def checksum(command):
    value = 0
    for byte in command:
        value ^= byte
    return b"%02X" % value


def ranges(first, last):
    """One byte each; none is a line feed, so that the tape reads well."""
    return bytes(32 + (step * 37 + first) % 90 for step in range(first, last + 1))


def answer(request):
    command, _, given = request.partition(b";")
    if checksum(command) != given:
        return command + b"\n02\n\n"
    if command[:2] == b"GD":
        data = ranges(int(command[2:6]), int(command[6:10]))
        return command + b"\n00\nSIZE %d\n" % len(data) + data + b"\n\n"
    if command not in LINES:
        return command + b"\n0E\n\n"
    return b"\n".join([command, b"00", *LINES[command], b"", b""])


def main():
    master, slave = os.openpty()
    tty.setraw(slave)
    print(os.ttyname(slave), flush=True)
    pending = b""
    while True:
        pending += os.read(master, 4096)
        while b"\n" in pending:
            request, _, pending = pending.partition(b"\n")
            time.sleep(LATENCY.get(request[:2], 0.01))
            os.write(master, answer(request))


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit(130)
