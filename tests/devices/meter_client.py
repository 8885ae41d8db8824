#!/usr/bin/python3
"""A driver that polls the energy meter of modbus_slave over Modbus RTU.

It has the bug of sample-logs/bug_meter: it takes the next bytes on the line for the answer. A stray byte ahead of a frame
shifts every later answer by one, and from then on no reading is right until it is started again. --fixed looks for a frame
whose checksum is right instead.
"""

import argparse
import struct
import sys
import time

from line import Line, run

SLAVE, READ_INPUT_REGISTERS, FIRST, COUNT = 1, 4, 200, 6
ANSWER_SIZE = 3 + 2 * COUNT + 2


def crc(data):
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return struct.pack("<H", value)


def framed(data):
    return data + crc(data)


def good(frame):
    return frame[:3] == bytes([SLAVE, READ_INPUT_REGISTERS, 2 * COUNT]) and crc(frame[:-2]) == frame[-2:]


def read_answer(line, fixed, timeout):
    frame = line.read_exactly(ANSWER_SIZE, timeout)
    strays = 0
    while fixed and not good(frame) and strays < ANSWER_SIZE:
        frame = frame[1:] + line.read_exactly(1, timeout)
        strays += 1
    if not good(frame):
        raise ValueError(f"bad frame {frame.hex(' ')}")
    return struct.unpack(">HHIHH", frame[3:-2]), strays


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("tty")
    parser.add_argument("--polls", type=int, default=10, metavar="N")
    parser.add_argument("--interval", type=float, default=0.1, help="seconds between polls (default 0.1)")
    parser.add_argument("--timeout", type=float, default=60, help="seconds to wait for an answer (default 60)")
    parser.add_argument("--fixed", action="store_true", help="without the bug")
    options = parser.parse_args()
    line = Line(options.tty, 19200)
    failed = 0
    for poll in range(1, options.polls + 1):
        line.write(framed(struct.pack(">BBHH", SLAVE, READ_INPUT_REGISTERS, FIRST, COUNT)))
        try:
            (volts, amps, energy, hertz, _), strays = read_answer(line, options.fixed, options.timeout)
            note = f" ({strays} stray byte skipped)" if strays else ""
            print(f"poll {poll}: {volts / 10:.1f} V, {amps / 1000:.3f} A, {energy} Wh, {hertz / 100:.2f} Hz{note}")
        except ValueError as error:
            failed += 1
            print(f"poll {poll}: {error}")
        time.sleep(options.interval)
    if failed:
        print(f"meter_client: {failed} of {options.polls} polls failed", file=sys.stderr)
        return 1
    print(f"ok: {options.polls} polls")
    return 0


if __name__ == "__main__":
    run(main)
