"""A device that is a program: what the line brings goes to its input, what it prints goes onto the line."""

import os
import signal
import subprocess
import threading
import tty

from far.quiet import Quiet

running = set()  # the process ids of all partners that run


class Partner(Quiet):
    """Starts the command in `folder` when the line is first opened: on pipes, or on a pty of its own where it wants a
    tty, whose name stands for {tty} in the command. It lives until end(), also while the line is closed.
    """

    def __init__(self, command, folder, rate=None, on_tty=False):
        super().__init__(rate)
        self._command, self._folder, self._on_tty = command, folder, on_tty
        self._process = None
        self._from, self._to = None, None
        self._reader = None
        self._lock = threading.Lock()
        self._said = bytearray()

    def opened(self, line):
        if self._process is None:
            self._start()

    def due(self):
        return 0 if self._said else None

    def tick(self, line):
        with self._lock:
            data, self._said = bytes(self._said), bytearray()
        line.send(data)

    def received(self, line, data):
        view = memoryview(data)
        try:
            while view:
                view = view[os.write(self._to, view):]
        except OSError:  # it has ended
            pass

    def end(self):
        if self._process is None:
            return
        try:
            os.killpg(self._process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        self._process.wait()
        self._reader.join(5)
        running.discard(self._process.pid)
        for fd in {self._from, self._to}:
            os.close(fd)

    def _start(self):
        if self._on_tty:
            master, slave = os.openpty()
            tty.setraw(slave)
            ends, theirs = (master, master), (slave, slave)
        else:
            (their_input, to), (from_, their_output) = os.pipe(), os.pipe()
            ends, theirs = (from_, to), (their_input, their_output)
        command = [os.ttyname(theirs[0]) if word == "{tty}" else word for word in self._command]
        self._process = subprocess.Popen(command, stdin=theirs[0], stdout=theirs[1], stderr=subprocess.DEVNULL,
                                         cwd=self._folder, start_new_session=True)
        running.add(self._process.pid)
        for fd in set(theirs):
            os.close(fd)
        self._from, self._to = ends
        self._reader = threading.Thread(target=self._listen, daemon=True)
        self._reader.start()

    def _listen(self):
        while True:
            try:
                data = os.read(self._from, 4096)
            except OSError:
                return
            if not data:
                return
            with self._lock:
                self._said += data
