"""Tapes for the page of `porttape view`, made byte by byte."""

import json
import pathlib
import random
import struct

HEADER = {"format": "porttape-events", "version": 1, "created": "2026-05-06T07:08:09Z", "tool": "porttape 0.1.0",
          "zero": {"wall": "2026-05-06T07:08:09.000000Z", "monotonic_us": 5, "boot": "x"}}
HOSTILE = "layer </script><img src=x onerror=document.title='owned'> \u202e \x1b[31m"


class Writer:
    """A tape of that name (without .log)."""

    def __init__(self, name):
        self.read, self.write = (open(f"{name}.log{side}", "wb") for side in "rw")
        self.events = [{"t_us": 0, "event": "open"}]
        self.name = name

    @staticmethod
    def block(file, at, data):
        file.write(struct.pack(">III", at // 1000000, at % 1000000, len(data)) + data)

    def note(self, at, event, **keys):
        self.events.append({"t_us": at, "event": event, **keys})

    def finish(self):
        self.read.close()
        self.write.close()
        lines = [HEADER, *self.events]
        pathlib.Path(f"{self.name}.loge").write_text("".join(json.dumps(line) + "\n" for line in lines))


def printer(name, exchanges, is_bad=False):
    """A printer that is asked; a bad one misses an answer, answers one wrongly, one late, and loses some bytes.

    Blocks: some eight thirds of the exchanges. Gives which exchange is which.
    """
    chance = random.Random(4)
    tape = Writer(name)
    at = 2000
    faults = {"unanswered": exchanges // 3, "odd": exchanges // 3 + 40, "slow": exchanges // 2, "gap": exchanges * 2 // 3}
    asks = b"M115\n", b"MOVE X%d Y%d\n", b"STATUS?\r\n"
    for number in range(exchanges):
        asked = asks[number % 3]
        tape.block(tape.write, at, asked % (number % 97, number % 31) if b"%" in asked else asked)
        answer = (b"ok FIRMWARE 2.1.%d\n" % (number % 7), b"ok\n", b"ok T:%d B:60 RUN=%d\r\n" % (chance.randrange(180, 220), number))[number % 3]
        latency = int(chance.lognormvariate(7.6, 0.35))
        pause = chance.randrange(500, 20000)
        if is_bad and number == faults["unanswered"]:
            at += 800000
            continue
        if is_bad and number == faults["odd"]: answer = b"Error:checksum\n"
        if is_bad and number == faults["slow"]: latency *= 60
        at += latency
        tape.block(tape.read, at, answer[:6])
        if len(answer) > 6:
            at += 180
            tape.block(tape.read, at, answer[6:])
        if is_bad and number == faults["gap"]:
            tape.note(at + 3000000, "gap", bytes=512, from_us=at + 500, why="the disk was full")
            at += 3000000
        if number % max(1, exchanges // 5) == 7: tape.note(at + 10, "mark", text=HOSTILE)
        at += pause
    tape.note(at, "close")
    tape.finish()
    return faults


def noise(name, blocks):
    """Blocks of chance, which nothing packs."""
    chance = random.Random(5)
    tape = Writer(name)
    at = 0
    for _ in range(blocks):
        at += chance.randrange(1, 3000)
        tape.block(chance.choice((tape.read, tape.write)), at, chance.randbytes(chance.randrange(1, 32)))
    tape.finish()
