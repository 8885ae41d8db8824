#!/usr/bin/python3
"""echo.py LINK: a serial device with RX and TX joined, as far as a pty can be one: what is written to LINK comes back.

Not in no time: what is written must not be there before its writer has left write(), which no wire can do. A flush of the
output drops what has not been sent. Prints "ready" when LINK is there. Asked by a line on its standard input, it prints
"quiet" as soon as nothing has come for a while; it ends with its standard input.
"""

import fcntl
import os
import select
import struct
import sys
import termios
import time
import tty

WAY = 0.002  # seconds from TX to RX: two bytes at 9600 baud
QUIET = 0.1


def drop(master):
    """What is written and not yet sent. Each read has a status byte ahead."""
    while select.select([master], [], [], 0)[0]:
        os.read(master, 4096)


def main(link):
    master, slave = os.openpty()  # held: a device does not hang up when its user closes it
    tty.setraw(master)
    fcntl.ioctl(master, termios.TIOCPKT, struct.pack("i", 1))
    os.symlink(os.ttyname(slave), link)
    print("ready", flush=True)
    asked = False
    while True:
        ready, _, _ = select.select([sys.stdin, master], [], [], QUIET if asked else None)
        if sys.stdin in ready:
            if not os.read(0, 100):
                return
            asked = True
        if not ready:
            print("quiet", flush=True)
            asked = False
        if master not in ready:
            continue
        status, *data = os.read(master, 4096)
        if status & termios.TIOCPKT_FLUSHWRITE:
            drop(master)
        if data:
            time.sleep(WAY)
            os.write(master, bytes(data))  # waits while nobody reads, as a full line does


if __name__ == "__main__":
    try:
        main(sys.argv[1])
    except KeyboardInterrupt:
        sys.exit(130)
