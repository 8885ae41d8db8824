"""pyserial_lines.py PORT: all that pyserial has for a line beside its data. What it finds is printed."""

import fcntl
import struct
import sys
import termios
import time

import serial
import serial.rs485

TIOCGICOUNT = 0x545D
WAIT_SECONDS = 10


def mode_of(port):
    """As the port's settings have it, not as pyserial remembers it."""
    cflag = termios.tcgetattr(port.fileno())[2]
    parity = "N" if not cflag & termios.PARENB else "O" if cflag & termios.PARODD else "E"
    bits = {termios.CS5: 5, termios.CS6: 6, termios.CS7: 7, termios.CS8: 8}[cflag & termios.CSIZE]
    return f"{bits}{parity}{2 if cflag & termios.CSTOPB else 1}"


def modes(path):
    for times in ("first", "second"):
        with serial.Serial(path, 9600, bytesize=8, parity="E") as port:
            print("opened for the", times, "time:", mode_of(port))
    with serial.Serial(path, 9600, bytesize=7, parity="E") as port:
        print("opened:", mode_of(port))
        for parity, bits in (("O", 7), ("E", 7), ("N", 8), ("E", 8), ("E", 8)):
            port.bytesize, port.parity = bits, parity
            print(f"asked for {bits}{parity}1:", mode_of(port))
        talk(port, b"at 8E1")


def talk(port, words):
    port.timeout = WAIT_SECONDS
    port.write(words)
    port.flush()
    print("sent back:", port.read(len(words)))


def show(port, why, **expected):
    """The signals, once they are as they must be; on a line that is replayed they may need a moment."""
    deadline = time.monotonic() + WAIT_SECONDS
    while any(getattr(port, name) != state for name, state in expected.items()) and time.monotonic() < deadline:
        time.sleep(0.005)
    print(f"{why}: rts {port.rts} dtr {port.dtr} cts {port.cts} dsr {port.dsr} cd {port.cd} ri {port.ri}")
    wrong = [name for name, state in expected.items() if getattr(port, name) != state]
    if wrong:
        sys.exit(f"{why}: wrong are {', '.join(wrong)}")


def signals(port):
    show(port, "at first", cts=True, dsr=True, cd=True)
    port.rts = False
    show(port, "without rts", cts=False)
    port.dtr = False
    show(port, "without dtr", dsr=False, cd=False)
    port.rts = True
    show(port, "with rts", cts=True)
    port.dtr = True
    show(port, "with dtr", dsr=True, cd=True)
    counts = struct.unpack("20i", fcntl.ioctl(port.fileno(), TIOCGICOUNT, bytes(80)))
    print("changes counted: cts", counts[0] >= 2, "dsr", counts[1] >= 2, "ri", counts[2] > 0, "cd", counts[3] >= 2)


def breaks(port):
    talk(port, b"before the break")
    port.send_break(0.05)
    talk(port, b"behind it")
    port.break_condition = True
    print("break:", port.break_condition)
    port.break_condition = False
    print("break:", port.break_condition)
    talk(port, b"behind both")


def extras(port):
    port.set_low_latency_mode(True)
    print("low latency")
    port.rs485_mode = serial.rs485.RS485Settings(rts_level_for_tx=True, rts_level_for_rx=False)
    print("rs485:", port.rs485_mode is not None)
    port.rs485_mode = None


def main():
    path = sys.argv[1]
    modes(path)
    with serial.Serial(path, 9600, bytesize=7, parity="E") as port:
        print("opened:", mode_of(port))
        signals(port)
        breaks(port)
        extras(port)
        print("at last:", mode_of(port))


main()
