#!/usr/bin/python3
"""A satellite receiver that pushes GGA and RMC sentences on a tty, moving along a seeded track. It reads nothing."""

import argparse
import math
import random
import time

from line import Line, LineClosed, run, sleep_until


def sentence(body):
    check = 0
    for char in body.encode():
        check ^= char
    return f"${body}*{check:02X}\r\n".encode()


def degrees(value, width, hemispheres):
    whole = int(abs(value))
    return f"{whole:0{width}d}{(abs(value) - whole) * 60:07.4f},{hemispheres[value < 0]}"


class Track:
    """A vehicle at sea: position, course and speed wander, one step a fix."""

    def __init__(self, seed, interval):
        self.random = random.Random(seed)
        self.interval = interval
        self.seconds = 12 * 3600.0
        self.latitude, self.longitude = 54.1801, 7.8895
        self.course, self.knots = 75.0, 6.0

    def next_fix(self):
        self.seconds = (self.seconds + self.interval) % 86400
        self.course = (self.course + self.random.gauss(0, 2)) % 360
        self.knots = min(12.0, max(1.0, self.knots + self.random.gauss(0, 0.2)))
        miles = self.knots * self.interval / 3600
        self.latitude += miles / 60 * math.cos(math.radians(self.course))
        self.longitude += miles / 60 * math.sin(math.radians(self.course)) / math.cos(math.radians(self.latitude))
        hundredths = round(self.seconds * 100) % 8640000
        clock = f"{hundredths // 360000:02d}{hundredths // 6000 % 60:02d}{hundredths % 6000 / 100:05.2f}"
        place = degrees(self.latitude, 2, "NS") + "," + degrees(self.longitude, 3, "EW")
        satellites = self.random.randint(7, 11)
        return (sentence(f"GPGGA,{clock},{place},1,{satellites:02d},0.9,4.2,M,45.1,M,,")
                + sentence(f"GPRMC,{clock},A,{place},{self.knots:.1f},{self.course:.1f},010226,,,A"))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("tty")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--hz", type=float, default=5, help="fixes per second (default 5)")
    parser.add_argument("--rate", type=float, default=0, help="bytes per second of its UART (default: no limit)")
    options = parser.parse_args()
    line, track = Line(options.tty), Track(options.seed, 1 / options.hz)
    due = time.monotonic()
    try:
        while True:
            line.write_paced(track.next_fix(), options.rate)
            due += 1 / options.hz
            sleep_until(due)
    except LineClosed:
        return 0


if __name__ == "__main__":
    run(main)
