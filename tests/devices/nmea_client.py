#!/usr/bin/python3
"""A navigation driver: reads NMEA sentences from a tty and checks checksums, order and plausibility."""

import argparse

from line import Line, run


def fields(raw):
    """The fields of one sentence; ValueError when its frame or its checksum is wrong."""
    text = raw.strip().decode("ascii")
    body, star, given = text[1:].partition("*")
    check = 0
    for char in body.encode():
        check ^= char
    if text[:1] != "$" or not star or f"{check:02X}" != given:
        raise ValueError(f"bad sentence {text!r}")
    return body.split(",")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("tty")
    parser.add_argument("--sentences", type=int, default=20, metavar="N", help="end after so many (default 20)")
    parser.add_argument("--timeout", type=float, default=60, help="seconds to wait for a sentence (default 60)")
    options = parser.parse_args()
    line = Line(options.tty)
    first = line.read_until(b"\n", options.timeout)
    if not first.startswith(b"$"):  # opened in mid-sentence
        first = line.read_until(b"\n", options.timeout)
    seen, clock, raw = 0, None, first
    while True:
        sentence = fields(raw)
        if clock is not None and float(sentence[1]) < clock:
            raise ValueError(f"time goes back: {clock} to {sentence[1]}")
        clock = float(sentence[1])
        seen += 1
        if sentence[0].endswith("GGA"):
            print(f"fix at {sentence[1]}: {sentence[2]} {sentence[3]} {sentence[4]} {sentence[5]}, {int(sentence[7])} satellites")
        if seen == options.sentences:
            break
        raw = line.read_until(b"\n", options.timeout)
    print(f"ok: {seen} sentences")
    return 0


if __name__ == "__main__":
    run(main)
