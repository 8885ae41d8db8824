"""The files of a tape, read and written by code that shares nothing with the project's own.

As a program: `tapefile.py payload FILE` writes the bytes of a block file to stdout; a torn tail is left out.
"""

import json
import struct
import sys


def blocks(path):
    """[(microseconds, bytes)] of one block file; a torn tail is left out."""
    with open(path, "rb") as file:
        data = file.read()
    at, found = 0, []
    while at + 12 <= len(data):
        seconds, micros, length = struct.unpack_from(">III", data, at)
        if at + 12 + length > len(data):
            break
        found.append((seconds * 1_000_000 + micros, data[at + 12:at + 12 + length]))
        at += 12 + length
    return found


def payload(path):
    return b"".join(data for _, data in blocks(path))


def exchanges(write_path, read_path):
    """The tape as [(request, answer)]: the bytes of a run of writes, and all that was read before the next one."""
    merged = [(at, 0, data) for at, data in blocks(write_path)] + [(at, 1, data) for at, data in blocks(read_path)]
    merged.sort(key=lambda item: item[:2])
    found, answering = [], True
    for _, is_read, data in merged:
        if is_read:
            if found:
                found[-1][1] += data
            answering = True
        elif answering:
            found.append([data, b""])
            answering = False
        else:
            found[-1][0] += data
    return [tuple(pair) for pair in found]


def block(at, data):
    """One block, at so many microseconds."""
    return struct.pack(">III", *divmod(at, 1_000_000), len(data)) + data


def write(name, reads, events, transport="stream"):
    """Makes the tape NAMEr and NAMEe of [(microseconds, bytes)] that its device sent and of [(microseconds, event)]."""
    with open(name + "r", "wb") as file:
        file.writelines(block(at, data) for at, data in reads)
    header = {"format": "porttape-events", "version": 1, "transport": transport, "stamped": "arrival"}
    with open(name + "e", "w", encoding="utf-8") as file:
        file.writelines(json.dumps(line) + "\n" for line in [header, *({"t_us": at, **event} for at, event in events)])


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] != "payload":
        sys.exit("usage: tapefile.py payload FILE")
    sys.stdout.buffer.write(payload(sys.argv[2]))
