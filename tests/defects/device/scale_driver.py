#!/usr/bin/python3
"""Asks scale_device.py who it is, weighs, sets the tare, weighs again, reads its list, and ends. `scale_driver.py PORT`"""

import os
import select
import sys
import tty

from scale_device import CR, frame


def ask(line, text):
    os.write(line, frame(text))
    answer = b""
    while not answer.endswith(CR):
        if not select.select([line], [], [], 5)[0]:
            raise OSError(f"no answer to {text!r}")
        answer += os.read(line, 4096)
    return answer


def main():
    line = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
    tty.setraw(line)
    for text in (b"I", b"W", b"W", b"T", b"W", b"L20", b"Q"):
        print(ask(line, text).decode())
    os.close(line)


if __name__ == "__main__":
    sys.dont_write_bytecode = True
    main()
