#!/usr/bin/python3
"""ask_lines.py PORT (or a URL of pyserial): a driver that asks a device of lines five times, and sees to its answers."""
import sys

import serial

with serial.serial_for_url(sys.argv[1], 19200, timeout=60) as port:
    for number in range(5):
        question = b"question %d\n" % number
        port.write(question)
        answer = port.readline()
        if answer != b"got " + question:
            sys.exit("asked %r, answered %r" % (question, answer))
