"""A program under trouble, and what it left."""

import contextlib
import os
import select
import signal
import socket
import subprocess
import time

from places import TABLE_SIZE, read_table


class Program:
    """One process, watched from its start to its end. With `trouble` (see places.Trouble) its calls go wrong."""

    def __init__(self, world, command, trouble=None, addresses=(), memory=False):
        self.world = world
        self.status = self.usage = None
        self.killed = self.said_ready = False
        number = world.number()
        self.log_path = world.path(f"log{number}")
        self.out_path = world.path(f"out{number}")
        self.table = world.path(f"places{number}")
        with open(self.table, "wb") as file:
            file.truncate(TABLE_SIZE)
        self.notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self.notify.bind(world.path(f"notify{number}"))
        environment = dict(os.environ, LD_PRELOAD=world.config.library, TROUBLE_PROGRAM=os.path.basename(command[0]),
                           TROUBLE_PLACES=self.table, NOTIFY_SOCKET=world.path(f"notify{number}"), TMPDIR=world.folder,
                           RUNTIME_DIRECTORY=world.path("control"))
        if trouble:
            environment["TROUBLE"] = trouble.environment(addresses)
        if world.tapes:
            environment["TROUBLE_TAPES"] = world.tapes
        if memory:
            environment["TROUBLE_MEMORY"] = "1"
        self.started = time.monotonic()
        with open(self.log_path, "wb") as log, open(self.out_path, "wb") as out:
            self.process = subprocess.Popen(command, cwd=world.folder, env=environment, stdin=subprocess.DEVNULL,
                                            stdout=out, stderr=log, start_new_session=True)
        self.pid = self.process.pid
        self.pidfd = os.pidfd_open(self.pid)

    def wait_ready(self, there, seconds):
        """Until `there()`, which is looked at often. False: it has ended, or takes too long."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not self.wait(0):
            if there():
                return True
            if self.notify in select.select([self.pidfd, self.notify], [], [], 0.02)[0]:
                self.said_ready = b"READY=1" in self.notify.recv(4096) or self.said_ready
        return False

    def wait(self, seconds):
        """Whether it has ended."""
        if self.status is not None:
            return True
        if not select.select([self.pidfd], [], [], seconds)[0]:
            return False
        _, status, self.usage = os.wait4(self.pid, 0)
        self.process.returncode = self.status = os.waitstatus_to_exitcode(status)
        return True

    def has_master_of(self, slave):
        """Whether it holds the other side of that open pty."""
        wanted = f"tty-index:\t{os.minor(os.fstat(slave).st_rdev)}\n"
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # it is ending
            for name in os.listdir(f"/proc/{self.pid}/fdinfo"):
                with contextlib.suppress(FileNotFoundError), open(f"/proc/{self.pid}/fdinfo/{name}", encoding="ascii") as file:
                    if wanted in file.read():
                        return True
        return False

    def signal(self, number):
        if self.status is None:
            signal.pidfd_send_signal(self.pidfd, number)

    def kill(self):
        if self.status is None:
            self.killed = True
            self.signal(signal.SIGKILL)
            self.wait(10)

    def close(self):
        self.kill()
        os.close(self.pidfd)
        self.notify.close()

    @property
    def cpu_seconds(self):
        return self.usage.ru_utime + self.usage.ru_stime if self.usage else 0

    @property
    def log(self):
        with open(self.log_path, encoding="utf-8", errors="replace") as file:
            return file.read()

    @property
    def out(self):
        with open(self.out_path, encoding="utf-8", errors="replace") as file:
            return file.read()

    @property
    def sites(self):
        return read_table(self.table)
