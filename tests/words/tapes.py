"""Wrong and mixed-up tapes, made of two good ones that porttaped records here."""

import fcntl
import os
import signal
import socket
import struct
import subprocess
import sys
import time


def block(at, data):
    return struct.pack(">III", at // 1_000_000, at % 1_000_000, len(data)) + data


def blocks(data):
    """[(offset, bytes of the block)]"""
    at, found = 0, []
    while at < len(data):
        end = at + 12 + struct.unpack_from(">I", data, at + 8)[0]
        found.append((at, data[at:end]))
        at = end
    return found


def native(data):
    """The same blocks in the older layout."""
    return b"".join(struct.pack("<qqQ", *struct.unpack_from(">III", each)) + each[12:] for _, each in blocks(data))


def until(what, condition):
    """Waits for what comes by itself."""
    end = time.monotonic() + 60
    while not condition():
        if time.monotonic() > end:
            sys.exit(f"words: {what} did not come")
        time.sleep(0.005)


def record(daemon, name, answers):
    """A tape with its events and digests: a driver asks for each answer over a Unix socket."""
    device = socket.socket(socket.AF_UNIX)
    device.bind("device")
    device.listen()
    command = [daemon, "record", "--device", "unix:device", "--driver", "unix-listen:driver", "--tape", name]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    driver = socket.socket(socket.AF_UNIX)
    until("the driver's socket", lambda: driver.connect_ex("driver") == 0)
    line, _ = device.accept()
    for number, answer in enumerate(answers):
        driver.sendall(b"question %d\n" % number)
        line.recv(100)
        line.sendall(answer)
        driver.recv(100)
    for each in (driver, line, device):
        each.close()
    process.send_signal(signal.SIGTERM)
    process.wait(60)
    os.unlink("device")


def parts(name):
    found = {}
    for end in "rwe":
        with open(f"{name}.log{end}", "rb") as file:
            found[end] = file.read()
    return found


def write(name, tape):
    for end, data in tape.items():
        if data is not None:
            with open(f"{name}.log{end}", "wb") as file:
                file.write(data)


def make(daemon):
    """Makes them in the current folder. What it gives is to be kept: the lock of the one being written."""
    record(daemon, "good", [b"answer %d\n" % n for n in range(8)])
    record(daemon, "other", [b"something else\n"] * 3)
    good, other = parts("good"), parts("other")
    read, events = good["r"], good["e"]
    half = blocks(read)[4][0]
    line = events.index(b"\n") + 1  # behind the header
    wrong = {
        "missing_r": {"r": None},
        "missing_w": {"w": None},
        "missing_e": {"e": None},
        "swapped": {"r": good["w"], "w": read},
        "foreign_e": {"e": other["e"]},
        "foreign_r": {"r": other["r"]},
        "mixed": {"r": other["r"], "w": other["w"]},
        "shortened": {"r": read[:half]},
        "only_e": {"r": None, "w": None},
        "changed": {"r": read[:half - 2] + b"?" + read[half - 1:]},
        "torn": {"r": read[:-3]},
        "length": {"r": read[:half + 8] + struct.pack(">I", 1 << 30) + read[half + 12:]},
        "time": {"r": read + block(0, b"late")},
        "micros": {"r": read[:half + 4] + struct.pack(">I", 1_000_000) + read[half + 8:]},
        "trailing": {"r": read + b"and some words behind the end"},
        "text": {"r": b"This is a letter, not a tape.\n" * 40, "w": b"Nor is this one.\n" * 40, "e": None},
        "binary": {"r": bytes(range(255, 0, -1)) * 20},
        "empty": {"r": b"", "w": b""},
        "events_damaged": {"e": events[:line] + b"{]\n" + events[line:]},
        "events_text": {"e": b"Dear reader, these are no events.\n"},
        "events_cut": {"e": events[:events[:-1].rindex(b"\n") + 1]},
        "native": {"r": native(read), "w": native(good["w"]), "e": None},
        "two_layouts": {"r": native(read), "e": None},
        "being_written": {},
        "closed": {},
        "fifo": {"r": None},
        "folder": {"r": None, "w": None, "e": None},
        "loop": {"r": None, "w": None, "e": None},
    }
    for name, changes in wrong.items():
        write(name, {**good, **changes})
    os.mkdir("folder.logr")
    os.mkfifo("fifo.logr")
    os.symlink("loop.logr", "loop.logr")
    os.chmod("closed.logr", 0)
    lock = open("being_written.logr", "r+b")
    fcntl.lockf(lock, fcntl.LOCK_EX)
    return lock
