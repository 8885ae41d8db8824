"""An Arduino: simavr runs the bootloader that Debian's arduino-core-avr has (arduino.c), at its own rate."""

import pathlib
import random
import subprocess

from far.partner import Partner

RATE = 115200
PROGRAM_SIZE = 4096


def hex_line(address, data, kind=0):
    record = bytes((len(data), address >> 8, address & 0xFF, kind)) + data
    return f":{(record + bytes((-sum(record) & 0xFF,))).hex().upper()}\n"


def make_program(folder):
    """program.hex: random words, no program that anyone would run."""
    data = random.Random(3).randbytes(PROGRAM_SIZE)
    lines = [hex_line(at, data[at:at + 16]) for at in range(0, PROGRAM_SIZE, 16)]
    (folder / "program.hex").write_text("".join(lines) + hex_line(0, b"", 1))


def arduino(folder, bootloader):
    source, program = pathlib.Path(__file__).with_suffix(".c"), folder / "arduino"
    subprocess.run(["gcc", "-O2", "-o", program, source, "-lsimavr"], check=True)
    return Partner([str(program), str(bootloader)], folder, rate=RATE)
