"""What is known of a driver: one entry of cases.py."""

import pathlib
from dataclasses import dataclass, field
from typing import Callable

ROOT = pathlib.Path(__file__).resolve().parents[3]


def nothing(*_):
    return None


def as_it_is(data):
    return data


@dataclass(frozen=True)
class Unpacked:
    """A file of a Debian package whose dependencies are not wanted: where the package is not installed, it is unpacked."""

    package: str
    file: str

    FOLDER = ROOT / "build/drivers"

    def path(self):
        """Where it is; None where it is not yet."""
        places = [pathlib.Path("/") / self.file, self.FOLDER / self.file]
        return next((place for place in places if place.is_file()), None)


@dataclass(frozen=True)
class NodeModule:
    """A module of node's, by npm: it lies beside what is unpacked, and nowhere else."""

    package: str
    version: str

    def path(self):
        place = Unpacked.FOLDER / "node_modules" / self.package
        return place if place.is_dir() else None


@dataclass(frozen=True)
class Exec:
    """How a driver is run under porttape's supervisor, where a pty is not enough for it."""

    refused: str = ""  # what it says on a plain pty, where it fails (a regular expression); none: it only loses there
    live: list = field(default_factory=list)  # options of porttape exec, on the device and when recorded
    replayed: list = field(default_factory=list)  # those against the tape
    tape: Callable = nothing  # (tape) -> what is wrong with it, or None


@dataclass(frozen=True)
class Case:
    name: str
    shows: str  # one line for --list
    packages: list
    script: list  # of this folder, and its arguments behind the port
    device: Callable  # (folder) -> the device, as far/end.py has it
    baud: int  # what the line has before the driver comes: the user's own setting
    seconds: int = 90  # for one way
    prepare: Callable = nothing  # (folder): makes what the driver's script finds there
    judge: Callable = nothing  # (device, folder) -> what is wrong at the far end, or None
    comparable: Callable = as_it_is  # what of the bytes that reached the device must be the same each time
    replay: list = field(default_factory=list)  # options of porttape test
    replay_script: list = field(default_factory=list)  # where the driver does something else then: in place of `script`
    forgives: Callable = nothing  # (report) -> why a verdict other than pass is the driver's own doing on any pty, or None
    device_options: str = ""  # of the device's port, when recorded
    unpacked: list = field(default_factory=list)
    exec: Exec = None  # all ways are under porttape exec

    @property
    def settings_checked(self):
        """Whether the replay looks for the driver's settings: they are made in the tape's order."""
        return "lookup" not in self.replay

    @property
    def settings_reach(self):
        """Whether what the driver sets is to reach the device."""
        return "settings=keep" not in self.device_options
