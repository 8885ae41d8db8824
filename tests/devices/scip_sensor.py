#!/usr/bin/python3
"""A laser scanner that speaks SCIP 2.0 on a tty: VV PP II BM QT RS GD GS MD MS.

Scans are seeded: the same seed and the same requests give the same answers.
"""

import argparse
import math
import random
import re
import time

import scip
from line import Line, LineClosed, run, sleep_until

STEPS = 768
FRONT = 384
SCAN_COMMAND = re.compile(rb"^([GM])([DS])(\d{4})(\d{4})(\d\d)(?:(\d)(\d\d))?$")


class Sensor:
    """What the scanner knows: its laser, its scan counter, and a streaming order under way. Answers are values; main() sends them."""

    def __init__(self, seed, period):
        self.random = random.Random(seed)
        self.period = period
        self.laser = False
        self.scan_number = 0
        self.stream = None  # (echo without the count, width, first, last, cluster, interval, scans left)

    def latency(self):
        return 0.002 + 0.004 * self.random.random()

    def handle(self, request):
        """The answer to one request line, and whether it waits for the next scan."""
        name = request[:2]
        if name == b"VV":
            return scip.answer(request, b"00", [
                b"VEND:The Porttape authors", b"PROD:Simulated scanner PT-04", b"FIRM:1.2.0",
                b"PROT:SCIP 2.0", b"SERI:S0000001"]), False
        if name == b"PP":
            return scip.answer(request, b"00", [
                b"MODL:PT-04", b"DMIN:20", b"DMAX:4095", b"ARES:1024", b"AMIN:44", b"AMAX:725",
                b"AFRT:%d" % FRONT, b"SCAN:600"]), False
        if name == b"II":
            return scip.answer(request, b"00", [
                b"MODL:PT-04", b"LASR:" + (b"ON" if self.laser else b"OFF"), b"SCSP:600",
                b"MESM:IDLE", b"SBPS:115200", b"TIME:%06X" % self.stamp(), b"STAT:stable"]), False
        if request == b"BM":
            status = b"02" if self.laser else b"00"
            self.laser = True
            return scip.answer(request, status), False
        if request in (b"QT", b"RS"):
            self.laser, self.stream = False, None
            return scip.answer(request, b"00"), False
        match = SCAN_COMMAND.match(request)
        if match:
            return self.scan_request(request, match)
        return scip.answer(request, b"0E"), False

    def scan_request(self, request, match):
        kind, coding, first, last, cluster, interval, scans = match.groups()
        first, last, cluster = int(first), int(last), max(1, int(cluster))
        if (kind == b"M") != (interval is not None) or last < first or last >= STEPS:
            return scip.answer(request, b"04"), False
        width = 3 if coding == b"D" else 2
        if kind == b"M":
            self.laser = True
            self.stream = [request[:-2], width, first, last, cluster, int(interval) + 1, int(scans)]
            return scip.answer(request, b"00"), False
        if not self.laser:
            return scip.answer(request, b"10"), False
        return self.scan(request, b"00", width, first, last, cluster), True

    def next_streamed(self):
        """The next answer of a streaming order; a count of 00 streams for ever."""
        echo, width, first, last, cluster, interval, left = self.stream
        self.scan_number += interval - 1
        if left:
            left -= 1
            self.stream = None if left == 0 else self.stream[:-1] + [left]
        answer = self.scan(echo + b"%02d" % left, b"99", width, first, last, cluster)
        if self.stream is None:
            self.laser = False
        return answer

    def stamp(self):
        return 4000 + self.scan_number * round(self.period * 1000)

    def scan(self, echo, status, width, first, last, cluster):
        """A room of about 3 x 2 m with a box that moves; a few readings are errors, as they are in life."""
        self.scan_number += 1
        box = 300 + self.scan_number * 5 % 160
        payload = b""
        for step in range(first, last + 1, cluster):
            angle = (step - FRONT) * 2 * math.pi / 1024
            walls = [1500 / abs(math.cos(angle)) if math.cos(angle) else 9e9,
                     1000 / abs(math.sin(angle)) if math.sin(angle) else 9e9]
            distance = 620 if box <= step < box + 40 else min(walls)
            distance += self.random.gauss(0, 4)
            if self.random.random() < 0.01:
                distance = 6  # "no echo"
            payload += scip.encode(max(0, min(4095, round(distance))), width)
        return scip.data_answer(echo, status, self.stamp(), payload)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("tty")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--period", type=float, default=0.1, help="seconds a scan (default 0.1)")
    parser.add_argument("--rate", type=float, default=0, help="bytes per second of its UART (default: no limit)")
    options = parser.parse_args()
    line, sensor = Line(options.tty), Sensor(options.seed, options.period)
    received, started = b"", time.monotonic()
    next_scan = None
    try:
        while True:
            if sensor.stream is None:
                next_scan = None
            elif next_scan is None:
                next_scan = time.monotonic() + options.period
            if not line.wait(None if next_scan is None else max(0.0, next_scan - time.monotonic())):
                line.write_paced(sensor.next_streamed(), options.rate)
                next_scan += options.period
                continue
            received += line.read_some()
            while b"\n" in received:
                request, received = received.split(b"\n", 1)
                answer, on_scan = sensor.handle(request.rstrip(b"\r"))
                time.sleep(sensor.latency())
                if on_scan:
                    sleep_until(started + math.ceil((time.monotonic() - started) / options.period) * options.period)
                line.write_paced(answer, options.rate)
    except LineClosed:
        return 0


if __name__ == "__main__":
    run(main)
