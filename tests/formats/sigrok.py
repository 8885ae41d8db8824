#!/usr/bin/env python3
"""What sigrok's UART decoder reads of our sessions, and a tape out of a session that sigrok-cli wrote.

PORTTAPE names the program.
"""

import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

TOOL = os.environ["PORTTAPE"]
SAMPLES = pathlib.Path(os.environ["PORTTAPE_SAMPLE_DIR"])

TEXT = """porttape-text 1
+0 event {{"event":"settings","by":"device","baud":{baud},"databits":8,"parity":"{parity}","stopbits":{stop}}}
+0.000100 w "AT\\r"
+0.5 r "OK\\r\\n"
+0.1 w "hello, world \\x00\\xff\\x55"
+0.000001 r "at the same time"
+0.1 end
"""


def run(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{command}: {done.stderr.decode()}")
    return done.stdout


def sent(tape, way):
    records = [json.loads(line) for line in run(TOOL, "cat", "--json", "--blocks", tape).decode().splitlines()]
    return b"".join(bytes.fromhex(record["hex"]) for record in records if "event" not in record and record["dir"] == way)


def same(one, other, what):
    if one != other:
        sys.exit(f"{what}: {one!r} is not {other!r}")


def check(tape, folder, options, *more):
    session = folder / f"{tape.stem}.sr"
    run(TOOL, "convert", tape, "-o", session, "--overwrite", *more)
    for way, line in ("r", "rx"), ("w", "tx"):
        decoder = f"uart:{options}:rx=rx:tx=tx"
        same(run("sigrok-cli", "-i", session, "-P", decoder, "-B", f"uart={line}"), sent(tape, way), f"{tape.name} {way}")
    again = folder / "again.sr"
    run("sigrok-cli", "-i", session, "-o", again)
    return again


def main():
    if not shutil.which("sigrok-cli"):
        print("skipped: sigrok-cli is not installed (Debian: sigrok-cli)")
        sys.exit(77)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for baud, parity, stop in (9600, "none", 1), (115200, "even", 2), (1200, "odd", 1), (250000, "none", 1):
            (folder / "small.txt").write_text(TEXT.format(baud=baud, parity=parity, stop=stop))
            run(TOOL, "convert", folder / "small.txt", "-o", folder / "small.log", "--overwrite")
            again = check(folder / "small.log", folder, f"baudrate={baud}:parity={parity}:stop_bits={stop}.0")
            run(TOOL, "convert", again, "--bytes-at", baud, "--device", f"parity={parity},stopbits={stop}",
                "-o", folder / "again.log", "--overwrite")
            for way in "r", "w":
                same(sent(folder / "again.log", way), sent(folder / "small.log", way), f"{baud} {parity} again")
        for sample in "bug_meter", "nmea":
            check(SAMPLES / f"{sample}.log", folder, "baudrate=230400", "--bytes-at", "230400")


if __name__ == "__main__":
    main()
