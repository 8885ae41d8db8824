#!/usr/bin/python3
"""Both ends of a line that is never quiet, each logging what it received: for killing a recorder in the middle.

Each end sends a stream whose bytes follow from their position, in chunks of random size. The device starts when the driver
has sent something.
"""

import argparse
import os
import random
import select

from line import Line, LineClosed, run


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("end", choices=["driver", "device"])
    parser.add_argument("tty")
    parser.add_argument("log", help="file for what is received; written before anything else happens")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    sizes = random.Random(options.seed)
    stream = random.Random(options.end).randbytes(1 << 16)
    line = Line(options.tty, 115200)
    log = os.open(options.log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)  # there: the line is ready
    os.set_blocking(line.fd, False)
    sending, sent = options.end == "driver", 0
    try:
        while True:
            readable, _, _ = select.select([line.fd], [], [], 0.0005)
            if readable:
                os.write(log, line.read_some())
                sending = True
            if sending and select.select([], [line.fd], [], 0)[1]:
                at = sent % len(stream)
                try:
                    sent += os.write(line.fd, stream[at:at + sizes.choice((1, 7, 60, 250, 1000))])
                except BlockingIOError:
                    pass
    except (LineClosed, OSError):
        return 0


if __name__ == "__main__":
    run(main)
