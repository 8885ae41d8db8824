#!/usr/bin/python3
"""elf32.py FILE: makes a program for 32-bit x86 that opens the port it is given and asks for its modem lines (TIOCMGET).
Its exit status is the error number of the one that failed, or 0. No compiler for such programs is needed."""

import os
import struct
import sys

CODE = bytes.fromhex(
    "8b5c2408"    # mov ebx, [esp+8]      the first argument
    "b902010000"  # mov ecx, O_RDWR|O_NOCTTY
    "b805000000"  # mov eax, open
    "cd80"
    "89c3"        # mov ebx, eax          the descriptor
    "85c0"        # test eax, eax
    "7813"        # js exit
    "b915540000"  # mov ecx, TIOCMGET
    "83ec04"      # sub esp, 4
    "89e2"        # mov edx, esp
    "b836000000"  # mov eax, ioctl
    "cd80"
    "89c3"        # mov ebx, eax
    "f7db"        # exit: neg ebx
    "b801000000"  # mov eax, exit
    "cd80")
BASE, HEADERS = 0x08048000, 52 + 32

header = b"\x7fELF\x01\x01\x01" + bytes(9) + struct.pack("<HHIIIIIHHHHHH", 2, 3, 1, BASE + HEADERS, 52, 0, 0, 52, 32, 1, 0, 0, 0)
segment = struct.pack("<IIIIIIII", 1, 0, BASE, BASE, HEADERS + len(CODE), HEADERS + len(CODE), 5, 0x1000)
with open(sys.argv[1], "wb") as file:
    file.write(header + segment + CODE)
os.chmod(sys.argv[1], 0o755)
