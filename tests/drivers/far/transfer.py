"""The far ends of file transfers: a Kermit server, lrzsz's rz and sz. Random files, the same each time."""

import os
import pathlib
import random

from far.partner import Partner

SIZE = 131072
MODIFIED = 1500000000  # a file's time travels with it

KERMIT_SERVER = """\
set carrier-watch off
set line TTY
set speed 115200
set flow-control none
set file type binary
set transfer display none
set transfer slow-start off
set streaming off
set window 1
set send timeout 60 fixed
set receive timeout 60
set receive packet-length 1000
server
"""


def make_files(folder):
    """up.bin, which the driver sends, and down.bin, which it gets."""
    for seed, name in enumerate(("up.bin", "down.bin")):
        path = pathlib.Path(folder) / name
        path.write_bytes(random.Random(seed).randbytes(SIZE))
        path.chmod(0o644)
        os.utime(path, (MODIFIED, MODIFIED))


def kermit(folder):
    make_files(folder)
    (folder / "up.bin").unlink()
    (folder / "server").write_text(KERMIT_SERVER)
    return Partner(["sh", "-c", 'sed "s,TTY,$0," server >here && exec kermit here -Y', "{tty}"], folder, on_tty=True)


def rz(folder):
    return Partner(["rz", "-b", "-y", "-q"], folder)


def sz(folder):
    make_files(folder)
    return Partner(["sz", "-b", "-q", "down.bin"], folder)


def received_whole(_device, folder):
    try:
        same = (folder / "up.bin").read_bytes() == (folder.parent / "up.bin").read_bytes()
    except FileNotFoundError:
        return "no up.bin came"
    return None if same else "another up.bin than was sent"
