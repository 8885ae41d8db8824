#!/usr/bin/env python3
"""What Wireshark makes of our captures: tshark's dissection against the tape, and a tape out of what editcap wrote.

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
SENT, RECEIVED, BREAK, COMPLETE = 1, 2, 9, 6

TEXT = r"""porttape-text 1
header {"format":"porttape-events","version":1,"zero":{"wall":"2024-05-06T07:08:08.999871Z"},"device":"serial:/dev/ttyUSB0"}
+0 open
+0 event {"event":"modem","line":"cts","state":"on","by":"device"}
+0.000100 w "AT\r"
+0.5 r "OK\r\n"
+0.1 mark "märk"
+0.1 event {"event":"modem","line":"cts","state":"off","by":"device"}
+0.1 event {"event":"break","state":"on","by":"driver"}
+0.1 r
+0.1 end
"""


def run(*command):
    return subprocess.run([str(part) for part in command], check=True, capture_output=True, text=True).stdout


def records(tape):
    lines = [json.loads(line) for line in run(TOOL, "cat", "--json", "--blocks", tape).splitlines()]
    for line in lines:  # counts and digests of an end are made anew
        if line.get("event") == "end":
            for key in ("read", "write", "events_xxh3", "line_xxh3"):
                line.pop(key, None)
    return lines


def dissected(capture):
    fields = ["frame.time_epoch", "rtacser.eventtype", "rtacser.cts", "frame.packet_flags_direction", "data.data",
              "frame.comment", "frame.interface_name", "_ws.malformed"]
    lines = run("tshark", "-r", capture, "-T", "fields", *[word for name in fields for word in ("-e", name)])
    return [dict(zip(fields, line.split("\t"))) for line in lines.splitlines()]


def same(one, other, what):
    if one != other:
        sys.exit(f"{what}: {one!r} is not {other!r}")


def check(tape, folder, suffix):
    capture = folder / f"{tape.stem}.{suffix}"
    run(TOOL, "convert", tape, "-o", capture, "--overwrite")
    packets = dissected(capture)
    whole = [record for record in records(tape) if "format" not in record]
    same(len(packets), len(whole), f"packets of {tape.name}")
    for packet, record in zip(packets, whole):
        same(packet["_ws.malformed"], "", "malformed")
        if "event" not in record:
            same(int(packet["rtacser.eventtype"], 0), RECEIVED if record["dir"] == "r" else SENT, "direction")
            same(packet["data.data"].replace(":", ""), record["hex"], "bytes")
            if suffix == "pcapng":
                same(int(packet["frame.packet_flags_direction"], 0), 1 if record["dir"] == "r" else 2, "flags")
        elif suffix == "pcapng" and '"event"' not in packet["frame.comment"]:
            sys.exit(f"an event without its comment: {packet}")
    same([packet["frame.time_epoch"] for packet in packets], sorted(packet["frame.time_epoch"] for packet in packets),
         "times")
    return packets


def main():
    if not shutil.which("tshark") or not shutil.which("editcap"):
        print("skipped: tshark is not installed (Debian: tshark)")
        sys.exit(77)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "small.txt").write_text(TEXT)
        run(TOOL, "convert", folder / "small.txt", "-o", folder / "small.log")
        for suffix in "pcapng", "pcap":
            packets = check(folder / "small.log", folder, suffix)
            same(packets[2]["frame.time_epoch"], "1714979288.999971000", "time")
            same([int(packet["rtacser.eventtype"], 0) for packet in packets],
                 [0, 0, SENT, RECEIVED, 0, 0, BREAK, RECEIVED, COMPLETE], "types")
            same([packet["rtacser.cts"] for packet in packets], list("011110000"), "CTS")
        packets = check(folder / "small.log", folder, "pcapng")
        same(packets[0]["frame.interface_name"], "serial:/dev/ttyUSB0", "interface")
        if "märk" not in packets[4]["frame.comment"]:
            sys.exit(f"no mark in {packets[4]}")
        for tape in sorted(SAMPLES.glob("*.logr")):
            check(tape.with_suffix(".log"), folder, "pcapng")
        # Written by Wireshark's own library, it is the same tape.
        for tape in [folder / "small.log", *(tape.with_suffix(".log") for tape in sorted(SAMPLES.glob("*.logr")))]:
            capture, again = folder / f"{tape.stem}.pcapng", folder / "again.pcapng"
            for program, *command in [["editcap", capture, again], ["mergecap", "-w", again, capture]]:
                run(program, *command)
                run(TOOL, "convert", again, "-o", folder / f"{program}-{tape.name}")
                same(records(folder / f"{program}-{tape.name}"), records(tape), f"{tape.name} by {program}")


if __name__ == "__main__":
    main()
