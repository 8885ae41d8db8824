#!/usr/bin/python3
"""A device on stdin and stdout: answers each line with that line behind `got `."""
import os
import sys

for line in iter(sys.stdin.buffer.readline, b""):
    os.write(1, b"got " + line)
