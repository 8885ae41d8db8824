#!/usr/bin/env python3
"""Many short exchanges over a serial line, and how late each answer was.

  exchanges.py device PATH                      says when it is ready, answers each message with itself, until the line is hung up
  exchanges.py driver PATH --seconds S          sends 16 bytes every --every ms and waits for the answer; prints one JSON line
"""

import argparse
import json
import time

import line

SIZE = 16


def device(path):
    port = line.Line(path)
    print("ready", flush=True)
    while True:
        try:
            port.write(port.read_some())
        except line.LineClosed:
            return 0


def driver(path, seconds, every):
    port = line.Line(path)
    late = []
    begin = time.monotonic()
    while (sent := time.monotonic()) < begin + seconds:
        message = b"%015d\n" % len(late)
        port.write(message)
        answer = port.read_exactly(SIZE, 60)
        if answer != message:
            raise ValueError(f"sent {message!r}, got {answer!r}")
        late.append((time.monotonic() - sent) * 1e3)
        line.sleep_until(sent + every / 1e3)
    print(json.dumps({"exchanges": len(late), "bytes": SIZE * len(late), "over_5_ms": sum(1 for ms in late if ms > 5),
                      "over_1_s": sum(1 for ms in late if ms > 1000), "worst_ms": round(max(late), 2)}), flush=True)
    port.close()
    return 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("side", choices=["device", "driver"])
    parser.add_argument("path")
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--every", type=float, default=10, help="ms between two messages")
    arguments = parser.parse_args()
    if arguments.side == "device":
        return device(arguments.path)
    return driver(arguments.path, arguments.seconds, arguments.every)


line.run(main)
