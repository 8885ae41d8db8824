#!/usr/bin/python3
"""A stand-in scale, on a pty of its own: prints where it is, then answers until it is ended.

A frame is STX, the length of its text (2 digits), the text, the XOR of length and text (2 digits) and CR; digits are hex. A request is a
letter and what it needs; its answer is the letter, a status (0: done) and what is asked for.
"""

import os
import sys
import time
import tty

STX, CR = b"\x02", b"\r"
LATENCY = 0.005  # seconds


def checksum(data):
    value = 0
    for byte in data:
        value ^= byte
    return b"%02X" % value


def frame(text):
    body = b"%02X" % len(text) + text
    return STX + body + checksum(body) + CR


class Scale:
    """What it knows: what lies on it, and the weight that counts as nothing."""

    def __init__(self):
        self.weights = [1250, 1250, 3775]  # grams, one after the other
        self.tare = 0

    def weight(self):
        grams = self.weights[0]
        if len(self.weights) > 1:
            self.weights.pop(0)
        return b"%+07d g" % (grams - self.tare)

    def answer(self, request):
        if request == b"I":
            return b"I0Stand-in scale"
        if request == b"W":
            return b"W0" + self.weight()
        if request == b"T":
            self.tare = 500
            return b"T0"
        if request[:1] == b"L":
            return b"L0" + b" ".join(b"%04d" % (1000 + 7 * n) for n in range(int(request[1:])))
        if request == b"Q":
            return b"Q0"
        return request[:1] + b"1"


def requests(data):
    """The texts of the whole frames at the front, and what is left."""
    texts = []
    while CR in data:
        one, _, data = data.partition(CR)
        body, given = one[1:-2], one[-2:]
        texts.append(body[2:] if one[:1] == STX and checksum(body) == given else b"?")
    return texts, data


def main():
    master, slave = os.openpty()
    tty.setraw(slave)
    print(os.ttyname(slave), flush=True)
    scale, pending = Scale(), b""
    while True:
        texts, pending = requests(pending + os.read(master, 4096))
        for text in texts:
            time.sleep(LATENCY)
            os.write(master, frame(scale.answer(text)))


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit(130)
