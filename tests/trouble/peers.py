"""The two ends of a line: a device that answers, and a driver that asks. Both keep what passed."""

import contextlib
import errno
import os
import select
import socket
import termios
import threading
import time
import tty

HUNG_UP = {errno.EIO, errno.ENXIO, errno.ENOENT, errno.ECONNRESET, errno.EPIPE, errno.ECONNREFUSED, errno.ENODEV,
           errno.ENOTCONN}


def question(session, number, size):
    return text_of(b"Q", session, number, size)


def text_of(letter, session, number, size):
    """A line of that many bytes; no part of it is in another one."""
    name = b"%s%d.%d" % (letter, session, number)
    text = b"".join(b"%s.%d " % (name, i) for i in range(size // (len(name) + 2) + 1))
    return text[:size - 1] + b"\n"


class Device(threading.Thread):
    """Answers each line of a question: `answer(line)`. Over the master of a pty, or a listening socket."""

    def __init__(self, answer, fd=None, listener=None, datagrams=False):
        super().__init__(daemon=True)
        self.answer, self.fd, self.listener, self.datagrams = answer, fd, listener, datagrams
        self.got, self.sent = b"", b""
        self.stop_reading, self.stop_writing = os.pipe()
        self.pending, self.rest = b"", b""
        self.silent = threading.Event()  # set: it does not read
        self.start()

    def run(self):
        if self.datagrams:
            return self.serve_datagrams()
        connection = None
        while True:
            fd = self.fd if self.listener is None else connection.fileno() if connection else None
            reading = [self.stop_reading] + ([fd] if fd is not None else [self.listener])
            ready, writable, _ = select.select(reading, [fd] if self.pending and fd is not None else [], [])
            if ready == [self.stop_reading]:
                break
            if self.listener in ready:
                connection = self.listener.accept()[0]
                connection.setblocking(False)
                self.pending = self.rest = b""
            if fd in writable:
                with contextlib.suppress(OSError):
                    size = os.write(fd, self.pending)
                    self.sent += self.pending[:size]
                    self.pending = self.pending[size:]
            if fd in ready and not self.receive(fd) and connection:
                connection.close()
                connection = None
        if connection:
            connection.close()
        return None

    def receive(self, fd):
        try:
            data = os.read(fd, 65536)
        except OSError as error:
            return error.errno in (errno.EAGAIN, errno.EINTR) or self.listener is None
        self.got += data
        *lines, self.rest = (self.rest + data).split(b"\n")
        for line in lines:
            self.pending += self.answer(line + b"\n")
        return bool(data)

    def serve_datagrams(self):
        while self.stop_reading not in select.select([self.stop_reading, self.listener], [], [])[0]:
            data, address = self.listener.recvfrom(65536)
            self.got += data
            answer = self.answer(data)
            self.listener.sendto(answer, address)
            self.sent += answer

    def end(self):
        os.write(self.stop_writing, b".")
        self.join()
        for fd in (self.stop_reading, self.stop_writing):
            os.close(fd)
        if self.listener:
            self.listener.close()


class SerialDevice(Device):
    """A device at the end of a tty, `path`."""

    def __init__(self, answer):
        master, self.slave = os.openpty()
        tty.setraw(self.slave, termios.TCSANOW)
        os.set_blocking(master, False)
        self.path = os.ttyname(self.slave)
        super().__init__(answer, fd=master)

    def end(self):
        super().end()
        os.close(self.fd)
        os.close(self.slave)


class NoDevice:
    """Where a tape is the device."""
    got = sent = b""
    datagrams = False

    @staticmethod
    def is_alive():
        return False


class Broken(Exception):
    """The line is down."""


class Stuck(Exception):
    """Nothing comes, and nothing is taken."""


class Wrong(Exception):
    """Other bytes came than were sent."""


class Driver:
    """Asks. `sent` is what the kernel took of it, `got` what came back; of all sessions."""

    def __init__(self, patience=8):
        self.sent, self.got, self.fd, self.socket, self.patience = b"", b"", None, None, patience

    def open_path(self, path):
        try:
            self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise Broken(f"open: {error.strerror}") from error

    def connect(self, family, address, kind=socket.SOCK_STREAM):
        self.socket = socket.socket(family, kind)
        self.socket.settimeout(self.patience)
        try:
            self.socket.connect(address)
        except OSError as error:
            self.close()
            raise Broken(f"connect: {error}") from error
        self.socket.setblocking(False)
        self.fd = self.socket.fileno()

    @property
    def is_tty(self):
        return self.socket is None

    def close(self):
        if self.socket:
            self.socket.close()
        elif self.fd is not None:
            os.close(self.fd)
        self.socket = self.fd = None

    def ask(self, text, answer):
        """Writes, and reads what must come; no more than that may come."""
        came, end = b"", time.monotonic() + self.patience
        left = text
        while left or len(came) < len(answer):
            ready, writable, _ = select.select([self.fd], [self.fd] if left else [], [], max(0, end - time.monotonic()))
            if not ready and not writable:
                raise Stuck(f"{len(text) - len(left)} of {len(text)} bytes written, {len(came)} of {len(answer)} read")
            try:
                if writable:
                    size = os.write(self.fd, left)
                    self.sent += left[:size]
                    left = left[size:]
                if ready:
                    data = os.read(self.fd, 65536)
                    if not data:
                        raise Broken("end of file")
                    self.got += data
                    came += data
            except OSError as error:
                if error.errno in (errno.EAGAIN, errno.EINTR):
                    continue
                if error.errno not in HUNG_UP:
                    raise
                raise Broken(error.strerror) from error
            if not answer.startswith(came):
                raise Wrong(f"{came[:60]!r} ({len(came)} bytes) came for {answer[:60]!r} ({len(answer)} bytes)")
