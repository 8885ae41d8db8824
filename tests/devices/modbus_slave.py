#!/usr/bin/env python3
"""The energy meter of modbus_slave.cpp on Modbus RTU, in plain Python: the device of ./demo, which compiles nothing for it.

usage: modbus_slave.py TTY [BAUD]

Answers slave 1's functions 1 to 6, 15 and 16 with the same values as modbus_slave.cpp, byte for byte, but for its hardware
revision B. Ends when the line is hung up.
"""
import os
import struct
import sys

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from line import Line, LineClosed  # noqa: E402

SLAVE = 1
BITS, REGISTERS, METER = 64, 256, 200
MOST_BITS, MOST_REGISTERS = 2000, 125
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3


def crc(data):
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return struct.pack("<H", value)


class Refused(Exception):
    """A request that is answered by an exception, whose code is the argument."""


class Meter:
    def __init__(self):
        self.coils = [n % 2 == 1 for n in range(BITS)]
        self.inputs = [n % 3 == 0 for n in range(BITS)]
        self.holding = [1000 + n for n in range(REGISTERS)]
        self.readings = [n * 257 & 0xFFFF for n in range(REGISTERS)]
        self.requests = 0

    def measure(self):
        self.requests += 1
        n = self.requests
        energy = 1_048_560 + 3 * n  # its low word wraps during a session
        self.readings[METER:METER + 6] = [2300 + n % 7, 4120 + n * 13 % 40, energy >> 16, energy & 0xFFFF, 4998 + n % 5, 0]

    def answer(self, request):
        """The answer to a request without slave and checksum."""
        self.measure()
        function, body = request[0], request[1:]
        try:
            if function in (1, 2):
                return bytes([function]) + self.read_bits(self.coils if function == 1 else self.inputs, body)
            if function in (3, 4):
                return bytes([function]) + self.read_registers(self.holding if function == 3 else self.readings, body)
            if function in (5, 6, 15, 16):
                self.write(function, body)
                return request[:5]
            raise Refused(ILLEGAL_FUNCTION)
        except Refused as refused:
            return bytes([function | 0x80, refused.args[0]])

    @staticmethod
    def part(table, first, count, most):
        if not 1 <= count <= most:
            raise Refused(ILLEGAL_VALUE)
        if first + count > len(table):
            raise Refused(ILLEGAL_ADDRESS)
        return table[first:first + count]

    def read_bits(self, table, body):
        bits = self.part(table, *struct.unpack(">HH", body), MOST_BITS)
        packed = bytearray((len(bits) + 7) // 8)
        for n, on in enumerate(bits):
            packed[n // 8] |= on << n % 8
        return bytes([len(packed)]) + bytes(packed)

    def read_registers(self, table, body):
        values = self.part(table, *struct.unpack(">HH", body), MOST_REGISTERS)
        return struct.pack(f">B{len(values)}H", 2 * len(values), *values)

    def write(self, function, body):
        first, value = struct.unpack(">HH", body[:4])
        if function == 5:
            self.part(self.coils, first, 1, 1)
            self.coils[first] = value == 0xFF00
        elif function == 6:
            self.part(self.holding, first, 1, 1)
            self.holding[first] = value
        elif function == 15:
            self.part(self.coils, first, value, MOST_BITS)
            self.coils[first:first + value] = [bool(body[5 + n // 8] >> n % 8 & 1) for n in range(value)]
        else:
            self.part(self.holding, first, value, MOST_REGISTERS)
            self.holding[first:first + value] = struct.unpack(f">{value}H", body[5:5 + 2 * value])


def read_request(line):
    """The next frame; its length follows from its function."""
    frame = line.read_exactly(2, None)
    if frame[1] in (15, 16):
        frame += line.read_exactly(5, None)
        return frame + line.read_exactly(frame[6] + 2, None)
    return frame + line.read_exactly(6, None)


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    line = Line(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 9600)
    meter = Meter()
    try:
        while True:
            frame = read_request(line)
            if frame[0] != SLAVE or crc(frame[:-2]) != frame[-2:]:
                line.flush_input()  # the next frame begins after what has come by now
                continue
            answer = bytes([SLAVE]) + meter.answer(frame[1:-2])
            line.write(answer + crc(answer))
    except LineClosed:
        pass


if __name__ == "__main__":
    main()
