"""line_driver.py PORT MARK STEP…: does each step on PORT and says what came of it, in words that are the same each time.

What a pty lacks: modem lines, parity, breaks, counters. MARK is a file that it makes when the far end need do no more of what
it waits for.
"""

import array
import fcntl
import os
import pathlib
import struct
import sys
import termios
import time

from driver import Port

TIOCGRS485, TIOCSRS485, TIOCGICOUNT, TIOCMIWAIT, TIOCMGET = 0x542E, 0x542F, 0x545D, 0x545C, 0x5415
ASYNC_LOW_LATENCY, RS485_ENABLED = 1 << 13, 1
BITS = {"dtr": termios.TIOCM_DTR, "rts": termios.TIOCM_RTS}
SIZES = {"7": termios.CS7, "8": termios.CS8}
PARITIES = {"N": 0, "E": termios.PARENB, "O": termios.PARENB | termios.PARODD}
HIDDEN = termios.CSIZE | termios.PARENB | termios.PARODD


def signals(port):
    """DTR and RTS, as they are read back."""
    got = array.array("i", [0])
    fcntl.ioctl(port.fd, TIOCMGET, got)
    return " ".join(f"{name} {'on' if got[0] & bit else 'off'}" for name, bit in BITS.items())


def do_drive(port, name, on):
    fcntl.ioctl(port.fd, termios.TIOCMBIS if on == "on" else termios.TIOCMBIC, struct.pack("i", BITS[name]))
    return signals(port)


def do_frame(port, frame):
    """9600 baud, and as 7E1."""
    mode = termios.tcgetattr(port.fd)
    wanted = SIZES[frame[0]] | PARITIES[frame[1]]
    mode[2] = mode[2] & ~(HIDDEN | termios.CSTOPB) | wanted
    mode[4] = mode[5] = termios.B9600
    termios.tcsetattr(port.fd, termios.TCSADRAIN, mode)
    kept = termios.tcgetattr(port.fd)[2] & HIDDEN == wanted
    port.exchange(b"at " + frame.encode(), 120)
    return "kept" if kept else "not kept"


def do_break(port):
    try:
        termios.tcsendbreak(port.fd, 0)
    except termios.error as error:
        return f"error {error.args[0]}"
    return "sent"


def do_drain(port):
    port.write(b"x" * 500 + b"\n")
    termios.tcdrain(port.fd)
    got = b""
    while not got.endswith(b"\n"):
        got += port.read(120)
    return f"{len(got)} bytes"


def line_from(port):
    """The next line, without the bytes that breaks are read as."""
    got = b""
    while not got.endswith(b"\n"):
        more = port.read(120)
        if not more:
            raise EOFError(f"the line hung up after {got!r}")
        got += more
    return got.replace(b"\0", b"").strip().decode()


def do_carrier(port, mark):
    """Waits until the far end has changed its carrier."""
    port.write(b"carrier\n")
    fcntl.ioctl(port.fd, TIOCMIWAIT, termios.TIOCM_CD | termios.TIOCM_DSR)
    mark.touch()
    return line_from(port)


def do_loop(port, _):
    """RTS leads to CTS: what it does is seen, and ends a wait."""
    before = array.array("i", [0] * 20)
    fcntl.ioctl(port.fd, TIOCGICOUNT, before)
    seen = []
    for on in (False, True, False, True):
        fcntl.ioctl(port.fd, termios.TIOCMBIS if on else termios.TIOCMBIC, struct.pack("i", termios.TIOCM_RTS))
        got, deadline = array.array("i", [0]), time.monotonic() + 60
        fcntl.ioctl(port.fd, TIOCMGET, got)
        while bool(got[0] & termios.TIOCM_CTS) != on and time.monotonic() < deadline:
            time.sleep(0.02)
            fcntl.ioctl(port.fd, TIOCMGET, got)
        seen.append("on" if got[0] & termios.TIOCM_CTS else "off")
    after = array.array("i", [0] * 20)
    fcntl.ioctl(port.fd, TIOCGICOUNT, after)
    return f"cts {' '.join(seen)}, counted {after[0] - before[0]}"


def do_counters(port):
    got = array.array("i", [0] * 20)  # cts dsr rng dcd rx tx frame overrun parity brk
    fcntl.ioctl(port.fd, TIOCGICOUNT, got)
    return f"carrier {'counted' if got[3] > 0 else 'not counted'}, break {'counted' if got[9] > 0 else 'not counted'}"


def do_serial(port):
    got = array.array("B", bytes(72))
    fcntl.ioctl(port.fd, termios.TIOCGSERIAL, got)
    flags, = struct.unpack_from("i", got, 16)
    struct.pack_into("i", got, 16, flags | ASYNC_LOW_LATENCY)
    fcntl.ioctl(port.fd, termios.TIOCSSERIAL, got)
    fcntl.ioctl(port.fd, termios.TIOCGSERIAL, got)
    return "low latency" if struct.unpack_from("i", got, 16)[0] & ASYNC_LOW_LATENCY else "not low latency"


def do_rs485(port):
    got = array.array("I", [0] * 8)
    got[0] = RS485_ENABLED
    try:
        fcntl.ioctl(port.fd, TIOCSRS485, got)
        fcntl.ioctl(port.fd, TIOCGRS485, got)
    except OSError as error:
        return f"error {error.errno}"
    return "on" if got[0] & RS485_ENABLED else "off"


def do_hangup(port, mark):
    mark.touch()
    return "hung up" if port.read(120) == b"" else "bytes"


def do_unplugged(port, mark):
    """Waits in a read until there is no device, and tries what else there is."""
    def attempt(call):
        try:
            return call()
        except OSError as error:
            return f"error {error.errno}"
        except termios.error as error:
            return f"error {error.args[0]}"

    mark.touch()
    tries = [lambda: os.read(port.fd, 64), lambda: os.read(port.fd, 64), lambda: os.write(port.fd, b"x"),
             lambda: termios.tcgetattr(port.fd), lambda: termios.tcdrain(port.fd),
             lambda: fcntl.ioctl(port.fd, termios.TIOCMBIC, struct.pack("i", termios.TIOCM_RTS))]
    return "; ".join(str(attempt(call)) for call in tries)


def do_cost(port):
    """How long a call that is trapped takes, and one that is not."""
    def median(call):
        times = []
        for _ in range(200):
            begin = time.monotonic()
            call()
            times.append(time.monotonic() - begin)
        return sorted(times)[100] * 1e6

    return f"{median(lambda: signals(port)):.0f} us, {median(lambda: fcntl.ioctl(port.fd, termios.TIOCOUTQ, bytes(4))):.0f} us"


def do_step(port, step, mark):
    words = step.split("=")
    if words[0] in BITS:
        return do_drive(port, *words)
    if words[0] == "say":
        port.exchange(words[1].encode(), 120)
        return "answered"
    if words[0] in ("carrier", "hangup", "loop", "unplugged"):
        return globals()[f"do_{words[0]}"](port, mark)
    if words[0] == "frame":
        return do_frame(port, words[1])
    return globals()[f"do_{words[0]}"](port)


def main(path, mark, steps):
    port = Port(path)
    print("open:", signals(port), flush=True)
    for step in steps:
        print(f"{step}:", do_step(port, step, pathlib.Path(mark)), flush=True)
    port.close()


if __name__ == "__main__":
    sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
    main(sys.argv[1], sys.argv[2], sys.argv[3:])
