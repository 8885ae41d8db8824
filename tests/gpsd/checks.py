"""What gpsd said against a log's .chk, as gpsd's own regress-driver compares them: by its sed, and by diff -b."""

import itertools
import re

DROPPED = re.compile(rb"^gpsd:|^gpsfake|GPS-DATA|WATCH|DEVICE|VERSION")
DEVICE = re.compile(rb',"device":[^,}]*')
BLANKS = re.compile(rb"[ \t\r\f\v]+")


def lines(said):
    """The lines that count, blanks as diff -b sees them."""
    kept = (line for line in said.split(b"\n") if not DROPPED.search(line))
    return as_compared(b"\n".join(DEVICE.sub(b"", line, count=1) for line in kept))


def as_compared(text):
    return [BLANKS.sub(b" ", line).rstrip(b" ") for line in text.removesuffix(b"\n").split(b"\n")]


def difference(said, chk):
    """None where it is the same, else the first line that differs, in words."""
    pairs = itertools.zip_longest(lines(said), as_compared(chk))
    for number, (got, expected) in enumerate(pairs, 1):
        if got != expected:
            return f"line {number}: expected {shown(expected)}, got {shown(got)}"
    return None


def shown(line):
    if line is None:
        return "the end"
    text = line.decode("utf-8", "backslashreplace")
    return text if len(text) <= 200 else text[:200] + "…"
