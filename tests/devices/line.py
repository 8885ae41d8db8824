"""One end of a serial line, for the simulators and clients of this folder. Standard library only."""

import errno
import os
import select
import sys
import termios
import time
import tty


class LineClosed(Exception):
    """The other end hung up."""


class Line:
    """A raw tty, 8N1. Owns its descriptor. Reads are by deadline and never short."""

    def __init__(self, path, baud=115200):
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd)
        mode = termios.tcgetattr(self.fd)
        mode[4] = mode[5] = getattr(termios, f"B{baud}")
        termios.tcsetattr(self.fd, termios.TCSANOW, mode)
        self.pending = b""

    def close(self):
        os.close(self.fd)

    def flush_input(self):
        self.pending = b""
        termios.tcflush(self.fd, termios.TCIFLUSH)

    def write(self, data):
        view = memoryview(data)
        while view:
            try:
                view = view[os.write(self.fd, view):]
            except OSError as error:
                raise closed_by(error) from error

    def write_paced(self, data, bytes_per_second, chunk=64):
        """Writes as a UART of that speed would: in chunks, each when its last byte would be through."""
        if not bytes_per_second:
            return self.write(data)
        start = time.monotonic()
        for at in range(0, len(data), chunk):
            piece = data[at:at + chunk]
            sleep_until(start + (at + len(piece)) / bytes_per_second)
            self.write(piece)

    def wait(self, seconds):
        """Whether a byte can be read within so many seconds (None: for ever)."""
        return bool(self.pending) or bool(select.select([self.fd], [], [], seconds)[0])

    def read_some(self):
        if self.pending:
            data, self.pending = self.pending, b""
            return data
        try:
            data = os.read(self.fd, 4096)
        except OSError as error:
            raise closed_by(error) from error
        if not data:
            raise LineClosed
        return data

    def read_until(self, end, seconds, count=1):
        """Everything up to and with the count-th `end`; TimeoutError (with what came) when it does not come in time."""
        deadline = time.monotonic() + seconds
        data = b""
        while data.count(end) < count:
            self._wait_for_more(deadline, data)
            data += self.read_some()
        at = -len(end)
        for _ in range(count):
            at = data.index(end, at + len(end))
        cut = at + len(end)
        self.pending = data[cut:]
        return data[:cut]

    def read_exactly(self, size, seconds):
        """`size` bytes; TimeoutError when they do not come in time (None: waits for ever)."""
        deadline = None if seconds is None else time.monotonic() + seconds
        data = b""
        while len(data) < size:
            self._wait_for_more(deadline, data)
            data += self.read_some()
        self.pending = data[size:]
        return data[:size]

    def _wait_for_more(self, deadline, data):
        if not self.wait(None if deadline is None else max(0.0, deadline - time.monotonic())):
            self.pending = data
            raise TimeoutError(f"no answer in time; so far {data[-80:]!r}")


def closed_by(error):
    return LineClosed() if error.errno in (errno.EIO, errno.EPIPE) else error


def sleep_until(when):
    time.sleep(max(0.0, when - time.monotonic()))


def run(main):
    """Runs main() as a program: a closed line ends it quietly, anything expected becomes one line and status 1."""
    try:
        sys.exit(main())
    except LineClosed:
        print(f"{os.path.basename(sys.argv[0])}: the line was hung up", file=sys.stderr)
        sys.exit(1)
    except (OSError, ValueError) as error:
        print(f"{os.path.basename(sys.argv[0])}: {error}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)
