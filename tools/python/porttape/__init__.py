"""Tapes in tests: a device's recording in the device's place.

    with porttape.Replay("tapes/laser") as laser:
        subprocess.run(["./laser_driver", laser.port], check=True)
        laser.finish().check()

It runs the program `porttape` and needs nothing but Python 3.9. For pytest: `porttape.pytest`.
"""
from __future__ import annotations

import json
import os
import pathlib
import selectors
import shutil
import socket
import subprocess
import tempfile
import time
import weakref
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

__all__ = ["Error", "Mismatch", "Replay", "Verdict", "find_program"]

# Tells the port, then lives as long as the line from us is open: however we end, it ends too.
_HOLD = 'printf "%s\\n%s\\n%s\\n" "$PORTTAPE_PORT" "$PORTTAPE_HOST" "$PORTTAPE_TCP_PORT"; exec cat >/dev/null'
_OF_THE_COMMAND = ("  repeat  ", "  step  ")
_START_LIMIT_S = 30.0
_END_LIMIT_S = 60.0


class Error(Exception):
    """There was no run: no such tape, a wrong option, no program. The message says what to do."""


class Mismatch(AssertionError):
    """The driver did not do as recorded. The message is the report."""


def find_program() -> str:
    """The program `porttape`: $PORTTAPE, the one installed with this module, or the one in $PATH."""
    given = os.environ.get("PORTTAPE")
    if given:
        return given
    beside = pathlib.Path(__file__).resolve().parents[4] / "bin" / "porttape"
    found = str(beside) if os.access(beside, os.X_OK) else shutil.which("porttape")
    if found is None:
        raise Error("the program porttape is neither in $PATH nor named by $PORTTAPE")
    return found


@dataclass(frozen=True)
class Verdict:
    """What came of a run."""

    exit_status: int
    """0: the driver did as recorded; 3: other data; 4: other timing; 5: incomplete; 1: failed."""
    text: str
    """The report for a person."""
    report: dict[str, Any] = field(default_factory=dict)
    """The report of tools/OUTPUT.md."""

    @property
    def passed(self) -> bool:
        """Whether the driver did all as recorded, and nothing else."""
        return self.exit_status == 0

    def check(self) -> None:
        """Raises Mismatch unless it passed."""
        if not self.passed:
            raise Mismatch(self.text)


class Replay:
    """A tape in a device's place, from start() until finish().

    `options` are those of `porttape test`, with `_` for `-`: strictness=2, rules="laser.toml",
    check_settings=True, driver="tcp-listen:127.0.0.1:0".
    """

    def __init__(self, tape: str | os.PathLike[str], **options: object) -> None:
        self._tape = os.fspath(tape)
        self._options = options
        self._folder: str | None = None
        self._line_to_it: socket.socket | None = None
        self._process: subprocess.Popen[str] | None = None
        self._verdict: Verdict | None = None
        self.port: str = ""
        """What the driver is to open: the path of a tty, or HOST:PORT."""
        self.host: str = ""
        """Of a socket."""
        self.tcp_port: int = 0
        """Of a socket."""

    def start(self) -> "Replay":
        """Makes the port. Raises Error, and OSError where no process is to be had."""
        self._folder = tempfile.mkdtemp(prefix="porttape-")
        # Should finish() not be called; in this process alone, and not where a fork of it ends.
        self._removes_folder = weakref.finalize(self, _remove_folder, self._folder, os.getpid())
        try:
            self._begin()
            self.port, self.host, number = (self._line() for _ in range(3))
        except BaseException:
            self._close()
            raise
        self.tcp_port = int(number or 0)
        return self

    def _begin(self) -> None:
        """Starts the program."""
        # A socket, and no pipe: of a pipe each process that the test has forked has the end too, and keeps it open.
        self._line_to_it, its_end = socket.socketpair()
        # Into a file: nobody needs to read it while the test runs.
        with its_end, open(self._notes_file(), "w", encoding="utf-8") as notes:
            self._process = subprocess.Popen(
                self._command(),
                stdin=its_end,
                stdout=subprocess.PIPE,
                stderr=notes,
                text=True,
                errors="replace",
                start_new_session=True,
            )

    def finish(self) -> Verdict:
        """Ends the run, whoever still has the port, and says what came of it. The same whenever it is called."""
        if self._verdict is None:
            try:
                self._verdict = self._finish()
            finally:
                self._close()
        return self._verdict

    def __enter__(self) -> "Replay":
        return self.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.finish()

    def _command(self) -> list[str]:
        command = [find_program(), "test", "--tape", self._tape, "--color", "never"]
        command += ["--timeout", "0", "--report", self._report_file()]
        for name, value in self._options.items():
            option = "--" + name.replace("_", "-")
            if value is True:
                command.append(option)
            elif value is not None and value is not False:
                command += [option, str(value)]
        return command + ["--", "/bin/sh", "-c", _HOLD]

    def _report_file(self) -> str:
        assert self._folder is not None
        return os.path.join(self._folder, "report.json")

    def _notes_file(self) -> str:
        assert self._folder is not None
        return os.path.join(self._folder, "notes")

    def _notes(self) -> str:
        with open(self._notes_file(), encoding="utf-8", errors="replace") as notes:
            return notes.read()

    def _line(self) -> str:
        """One of the first lines, byte by byte: what follows them is for finish()."""
        assert self._process is not None and self._process.stdout is not None
        fd = self._process.stdout.fileno()
        until = time.monotonic() + _START_LIMIT_S
        line = b""
        with selectors.DefaultSelector() as selector:
            selector.register(fd, selectors.EVENT_READ)
            while not line.endswith(b"\n"):
                if not selector.select(until - time.monotonic()):
                    raise Error(f"porttape did not begin within {_START_LIMIT_S:.0f} s")
                byte = os.read(fd, 1)
                if not byte:
                    raise Error(self._why_not())
                line += byte
        return line[:-1].decode(errors="replace")

    def _why_not(self) -> str:
        assert self._process is not None
        self._process.wait(_END_LIMIT_S)
        notes = self._notes().strip().replace("porttape test: ", "")
        return notes or f"porttape ended with status {self._process.returncode}"

    def _finish(self) -> Verdict:
        if self._process is None:
            raise Error("the replay was never started")
        self._hang_up()
        try:
            text, _ = self._process.communicate(timeout=_END_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            raise Error(f"porttape did not end within {_END_LIMIT_S:.0f} s") from None
        report: dict[str, Any] = {}
        try:
            with open(self._report_file(), encoding="utf-8") as file:
                report = json.load(file)
        except (OSError, ValueError):
            pass  # it is told in the notes
        # The command is our own; what is told of it is the driver's, and what repeats it repeats no test.
        text = text.replace("the command never opened its port", "the driver never opened its port")
        lines = [line for line in text.splitlines(keepends=True) if not line.startswith(_OF_THE_COMMAND)]
        lines += [line for line in self._notes().splitlines(keepends=True) if "{port}" not in line]
        text = "".join(lines).rstrip()
        return Verdict(self._process.returncode, text or self._ended(), report)

    def _ended(self) -> str:
        assert self._process is not None
        return f"porttape ended with status {self._process.returncode}, and told no verdict"

    def _hang_up(self) -> None:
        """Ends the line to the program, whoever else has it open."""
        if self._line_to_it is None:
            return
        try:
            self._line_to_it.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass  # it has ended
        self._line_to_it.close()
        self._line_to_it = None

    def _close(self) -> None:
        self._hang_up()
        if self._process is not None:
            if self._process.stdout is not None:
                self._process.stdout.close()
            try:
                self._process.wait(_END_LIMIT_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        if self._folder is not None:
            self._removes_folder()
            self._folder = None


def _remove_folder(folder: str, process: int) -> None:
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)
