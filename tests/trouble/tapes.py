"""The tapes that a recording left, read by code of its own, and what of the line they have."""

import json
import os
import re
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "devices"))
import tapefile  # noqa: E402  (the folder has no package)


class Tape:
    """One tape: `base` is its name without the last letter."""

    def __init__(self, base):
        self.base = base
        self.read = tapefile.blocks(base + "r") if os.path.exists(base + "r") else []
        self.write = tapefile.blocks(base + "w") if os.path.exists(base + "w") else []
        self.events, self.damage = [], None
        if os.path.exists(base + "e"):
            with open(base + "e", "rb") as file:
                *lines, self.torn = file.read().split(b"\n")
            try:
                self.events = [json.loads(line) for line in lines[1:]]
            except ValueError as error:
                self.damage = f"{os.path.basename(base)}e: {error}"

    @property
    def ended(self):
        return bool(self.events) and self.events[-1]["event"] == "end"

    @property
    def has_gap(self):
        return any(event["event"] == "gap" for event in self.events)

    @property
    def gap_bytes(self):
        return sum(event["bytes"] for event in self.events if event["event"] == "gap")

    @property
    def torn_bytes(self):
        whole = sum(12 + len(data) for _, data in self.read + self.write)
        return sum(os.path.getsize(self.base + x) for x in "rw" if os.path.exists(self.base + x)) - whole

    def steps_back(self):
        """The first time that is earlier than the one before, and no event."""
        for blocks in (self.read, self.write):
            for before, after in zip(blocks, blocks[1:]):
                if after[0] <= before[0]:
                    return f"{os.path.basename(self.base)}: {after[0]} µs comes after {before[0]} µs"
        return None

    def sound(self, porttape):
        """What `porttape verify` says: its status, and whether it calls the tape sound."""
        done = subprocess.run([porttape, "verify", self.base], capture_output=True, text=True, check=False)
        return done.returncode, re.search(r": sound: ", done.stdout) is not None, done.stdout + done.stderr


def tapes_in(folder):
    """Those of one recording, in the order in which they were made."""
    names = {name[:-1] for name in os.listdir(folder) if re.fullmatch(r"t(\.\d+)?\.log[rwe]", name)}
    number = lambda name: int((re.findall(r"\d+", name) or ["1"])[0])  # noqa: E731
    return [Tape(os.path.join(folder, name)) for name in sorted(names, key=number)]


def in_order(blocks, line):
    """Where the first of the blocks is that does not stand on the line behind the one before it; None: all do."""
    at = 0
    for number, (_, data) in enumerate(blocks):
        found = line.find(data, at)
        if found < 0:
            return f"block {number} of {len(blocks)}: {data[:40]!r}"
        at = found + len(data)
    return None


def is_piece(part, whole, slack):
    """Whether `part` is `whole` with no more than `slack` bytes taken out of it (or missing at its end)."""
    if len(whole) - len(part) > slack or len(part) > len(whole):
        return False
    at = 0
    while part:
        size = len(os.path.commonprefix([part, whole[at:]]))
        if size == len(part):
            return True
        part, at = part[size:], at + size
        # The next piece begins where its beginning is found again.
        found = whole.find(part[:24], at)
        if found < 0:
            return False
        at = found
    return True
