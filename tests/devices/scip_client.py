#!/usr/bin/python3
"""A laser driver: opens a tty, flushes before each request as real drivers do, checks every checksum.

By itself it runs VV PP II BM GD GD MD QT and prints a summary. With --script it sends the requests of a recording one by
one and compares each answer byte for byte with the recorded one; the fault options then make it a driver that has changed.
"""

import argparse
import sys
import time

import scip
import tapefile
from line import Line, run

SESSION = [b"VV", b"PP", b"II", b"BM", b"GD0044072501", b"GD0044072501", b"MD0384043101003", b"QT"]


def request_once(line, request, count, timeout):
    line.flush_input()
    line.write(request)
    return line.read_until(scip.END, timeout, count)


def run_session(line, options):
    """The built-in conversation. Returns what was received."""
    received, scans = [], 0
    for request in SESSION:
        count = 1 + int(request[-2:]) if request[:1] == b"M" else 1
        raw = request_once(line, request + b"\n", count, options.timeout)
        received.append(raw)
        for part in raw.split(scip.END)[:-1]:
            answer = scip.Answer(part + scip.END)
            if answer.echo[:-2] != request[:-2] or (request[:1] != b"M" and answer.echo != request):
                raise ValueError(f"answer to another request: sent {request!r}, got {answer.echo!r}")
            if answer.status not in (b"00", b"02", b"99"):
                raise ValueError(f"{request.decode()}: the sensor answers status {answer.status.decode()}")
            if answer.data:
                ranges = [r for r in answer.ranges(3) if r >= 20]
                scans += 1
                print(f"scan {scans}: {len(ranges)} readings, nearest {min(ranges)} mm, at {answer.stamp} ms")
            elif "PROD" in answer.fields:
                print(f"sensor: {answer.fields['PROD']}, firmware {answer.fields['FIRM']}")
    print(f"ok: {len(SESSION)} requests, {scans} scans")
    return b"".join(received)


def run_script(line, options):
    """The requests of a recording, answers compared. Returns what was received."""
    exchanges = tapefile.exchanges(options.script, options.expect)
    if options.leave_out_last:
        exchanges = exchanges[:-1]
    received, sent, wrong = b"", 0, 0
    for number, (request, answer) in enumerate(exchanges, 1):
        if options.change_byte is not None and sent <= options.change_byte < sent + len(request):
            at = options.change_byte - sent
            request = request[:at] + bytes([request[at] ^ 0x01]) + request[at + 1:]
        if options.delay and options.delay[0] == number:
            time.sleep(options.delay[1] / 1000)
        if options.pause:
            time.sleep(options.pause / 1000)
        got = request_once(line, request, answer.count(scip.END), options.timeout)
        sent += len(request)
        received += got
        if got != answer:
            wrong += 1
            print(f"answer {number} to {request!r} differs from the recorded one", file=sys.stderr)
        print(f"exchange {number}: {len(request)} bytes sent, {len(got)} read", flush=True)
    if wrong:
        raise ValueError(f"{wrong} of {len(exchanges)} answers differ")
    print(f"ok: {len(exchanges)} exchanges, {sent} bytes sent, {len(received)} read")
    return received


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("tty")
    parser.add_argument("--timeout", type=float, default=60, help="seconds to wait for an answer (default 60)")
    parser.add_argument("--save", metavar="FILE", help="write the received bytes there")
    script = parser.add_argument_group("replaying a recording's requests")
    script.add_argument("--script", metavar="FILE.logw", help="send these requests")
    script.add_argument("--expect", metavar="FILE.logr", help="and expect these answers")
    script.add_argument("--change-byte", type=int, metavar="N", help="flip a bit of the byte at this offset of all that is sent")
    script.add_argument("--delay", type=int, nargs=2, metavar=("K", "MS"), help="send request K so many ms late (1 is the first)")
    script.add_argument("--pause", type=int, metavar="MS", help="wait so long before each request")
    script.add_argument("--leave-out-last", action="store_true", help="end before the last request")
    options = parser.parse_args()
    if bool(options.script) != bool(options.expect):
        parser.error("--script and --expect go together")
    line = Line(options.tty)
    received = run_script(line, options) if options.script else run_session(line, options)
    if options.save:
        with open(options.save, "wb") as file:
            file.write(received)
    return 0


if __name__ == "__main__":
    run(main)
