"""A microcontroller in its boot loader, as ST's application note AN3155 has it: an STM32F10x of medium density, its
flash full of the same bytes each time. It speaks at the rate of the first byte that it hears, 8E1."""

import functools
import operator
import random

from far.quiet import Quiet

ACK, NACK, START = b"\x79", b"\x1f", 0x7F
FLASH, FLASH_SIZE = 0x08000000, 0x20000
VERSION, PRODUCT = 0x22, 0x0410
GET, GET_VERSION, GET_ID, READ = 0x00, 0x01, 0x02, 0x11


def flash_of(address, size):
    """What lies there; other memory is empty."""
    whole = random.Random("flash").randbytes(FLASH_SIZE)
    return bytes(whole[at - FLASH] if FLASH <= at < FLASH + FLASH_SIZE else 0 for at in range(address, address + size))


class Chip(Quiet):
    def __init__(self, rate=None):
        super().__init__(rate)
        self._heard = bytearray()
        self._awake = False
        self._expected = self._command  # takes a step of what was heard; returns how many bytes it used, 0: too few
        self._address = 0
        self.reads = 0

    def received(self, line, data):
        self._heard += data
        while self._heard and (used := self._expected(line, bytes(self._heard))):
            del self._heard[:used]

    def _command(self, line, heard):
        if not self._awake:
            self._awake = heard[0] == START
            line.send(ACK if self._awake else b"")
            return 1
        if len(heard) < 2:
            return 0
        answers = {
            GET: ACK + bytes((4, VERSION, GET, GET_VERSION, GET_ID, READ)) + ACK,
            GET_VERSION: ACK + bytes((VERSION, 0, 0)) + ACK,
            GET_ID: ACK + bytes((1, *PRODUCT.to_bytes(2, "big"))) + ACK,
            READ: ACK,
        }
        known = heard[0] ^ heard[1] == 0xFF and heard[0] in answers
        line.send(answers[heard[0]] if known else NACK)
        if known and heard[0] == READ:
            self._expected = self._read_address
        return 2

    def _read_address(self, line, heard):
        if len(heard) < 5:
            return 0
        right = functools.reduce(operator.xor, heard[:5]) == 0
        self._address = int.from_bytes(heard[:4], "big")
        line.send(ACK if right else NACK)
        self._expected = self._read_size if right else self._command
        return 5

    def _read_size(self, line, heard):
        if len(heard) < 2:
            return 0
        right = heard[0] ^ heard[1] == 0xFF
        line.send(ACK + flash_of(self._address, heard[0] + 1) if right else NACK)
        self.reads += right
        self._expected = self._command
        return 2
