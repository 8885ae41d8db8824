"""Tapes, read and written in Python alone.

    with porttape.tape.Reader("laser.log") as tape:
        for item in tape:
            if isinstance(item, porttape.tape.Block) and item.direction == "w":
                print(item.t_us, item.data)

    with porttape.tape.Writer("made.log", device="made by hand") as tape:
        tape.event(0, "open")
        tape.write(1000, b"VV\\n")
        tape.read(2500, b"VV\\n00P\\n\\n")

The format is that of libport/tape/FORMAT.md. Times are whole microseconds since the tape's zero. `r` is what the device
sent and the driver read, `w` what the driver wrote. Memory does not grow with the tape, but holds a block whole.
"""
from __future__ import annotations

import contextlib
import datetime
import errno
import fcntl
import json
import os
import pathlib
import re
import secrets
import socket
import stat
import struct
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, BinaryIO, Iterator, Union

__all__ = ["Block", "Damage", "Error", "Event", "Item", "Reader", "Writer", "find"]

_LOOK = 64 * 1024
_MOST_CLAIMED = 64 * 1024 * 1024
_LATEST_FIRST_S = 1 << 31
_SEARCH = 1024 * 1024
_TRIES = 100_000
_CHAIN = 8
_DAY_US = 24 * 3600 * 1_000_000
_LINE = 65536
_OFD_SETLK = 37  # as Linux has it; fcntl of older Pythons does not know the name
_DEEPEST = 32  # brackets of a line within one another
_MOST_EXPONENT = 2_147_483_647
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[\[\]{}]')
_LATEST_EVENT_US = (1 << 63) - 1  # readers take it for the end of a file
_MOST_US = 0xFFFFFFFF * 1_000_000 + 999_999


class Error(Exception):
    """There is no such tape, it is none, or it cannot be made. The message says what to do."""


class Damage(Error):
    """What is on the tape beyond here cannot be read; what came before is sound."""


@dataclass(frozen=True)
class Block:
    """Bytes that passed the line at once."""

    t_us: int
    direction: str
    """`r` or `w`."""
    data: bytes


@dataclass(frozen=True)
class Event:
    """What happened beside the bytes: a kind and keys of the events file."""

    t_us: int
    kind: str
    keys: dict[str, Any] = field(default_factory=dict)


Item = Union[Block, Event]


def find(name: str | os.PathLike[str]) -> pathlib.Path:
    """The tape that is meant by `laser.log`, `laser.logr`, `laser.logw` or `laser`, without its last letter."""
    text = os.fspath(name)
    candidates = [text, text + ".log"]
    if text.endswith(("r", "w", "e")):
        candidates.append(text[:-1])
    for base in candidates:
        if os.path.isfile(base + "r") or os.path.isfile(base + "w"):
            return pathlib.Path(base)
    raise Error(f"there is no tape '{text}': neither {text}r nor {text}.logr")


class _Layout:
    """How the headers of blocks are laid out."""

    def __init__(self, name: str, form: str) -> None:
        self.name = name
        self.form = struct.Struct(form)
        self.size = self.form.size

    def header(self, data: bytes | memoryview, at: int = 0) -> tuple[int, int, int]:
        """Seconds, microseconds and length, unchecked."""
        seconds, microseconds, length = self.form.unpack_from(data, at)
        return seconds, microseconds, length

    def fault(self, header: tuple[int, int, int], not_before_us: int) -> str | None:
        """What a header alone is guilty of."""
        seconds, microseconds, length = header
        if not 0 <= microseconds < 1_000_000:
            return f"microseconds are {microseconds}, not below 1000000"
        if not 0 <= seconds <= 0xFFFFFFFF:
            return f"seconds are {seconds}, beyond 32 bits"
        if length > 0xFFFFFFFF:
            return f"a length of {length}, beyond 32 bits"
        if seconds * 1_000_000 + microseconds < not_before_us:
            return f"the time {seconds}.{microseconds:06} s is before that of the block before"
        return None


_BIG_ENDIAN = _Layout("big-endian", ">III")
_NATIVE64 = _Layout("native 64-bit", "<qqQ")
_CLEAN, _GOES_ON, _TORN, _DAMAGED, _NO_TAPE = range(5)


@dataclass
class _Look:
    """The beginning of a file in a layout, from best to worst."""

    rank: int = _CLEAN
    blocks: int = 0
    """With data."""
    claims: int = 0
    """What an unfinished block says its length is."""
    needs_other: bool = False


def _blocks_follow(file: BinaryIO, layout: _Layout, start: int, not_before_us: int, size: int) -> bool:
    """Whether a chain of blocks begins behind a header whose length is too long."""
    file.seek(start)
    data = file.read(_SEARCH + layout.size)
    tries = 0
    for at in range(max(0, min(_SEARCH + 1, len(data) - layout.size + 1))):
        header = layout.header(data, at)
        if header[1] >= 1_000_000 or header[2] == 0:
            continue
        if layout.fault(header, not_before_us) is not None or start + at + layout.size + header[2] > size:
            continue
        time = header[0] * 1_000_000 + header[1]
        if time > not_before_us + _DAY_US:
            continue
        count, place = 1, start + at + layout.size + header[2]
        while place < size and count < _CHAIN:
            tries += 1
            if tries > _TRIES:
                return False
            file.seek(place)
            raw = file.read(layout.size)
            if len(raw) < layout.size:
                break
            follow = layout.header(raw)
            if layout.fault(follow, time + 1) is not None or place + layout.size + follow[2] > size:
                break
            follow_us = follow[0] * 1_000_000 + follow[1]
            if follow_us > time + _DAY_US:
                break
            time, count, place = follow_us, count + 1, place + layout.size + follow[2]
        if place == size or count >= _CHAIN:
            return True
    return False


def _look_at(path: pathlib.Path, layout: _Layout) -> _Look:
    look = _Look()
    try:
        file = _open_to_read(path)
    except FileNotFoundError:
        return look
    with file:
        size = os.fstat(file.fileno()).st_size
        data = file.read(_LOOK)
        at, last_us = 0, 0
        while at + layout.size <= len(data):
            header = layout.header(data, at)
            if layout.fault(header, last_us) is not None:
                look.rank = _DAMAGED if look.blocks else _NO_TAPE
                return look
            last_us = header[0] * 1_000_000 + header[1]
            if header[2] > size - at - layout.size:
                look.claims = header[2]
                if look.blocks or (header[2] <= _MOST_CLAIMED and header[0] < _LATEST_FIRST_S):
                    look.rank = _TORN
                else:
                    follows = _blocks_follow(file, layout, at + layout.size, last_us, size)
                    look.rank = _DAMAGED if follows else _NO_TAPE
                return look
            look.blocks += header[2] > 0
            at += layout.size + header[2]
        if at == size:
            return look
        if len(data) < size:
            look.rank = _GOES_ON
        elif look.blocks:
            look.rank = _TORN
        else:  # a part of a header
            part = data[at:]
            look.needs_other = len(part) < 8 if layout is _NATIVE64 else part[0] != 0 and len(part) <= 8
            whole = part + bytes(layout.size - len(part))
            look.rank = _TORN if layout.fault(layout.header(whole), 0) is None else _NO_TAPE
    return look


def _layout_of(base: pathlib.Path) -> _Layout:
    """The same for both files; the better one where both are possible."""
    found = []
    for layout in (_BIG_ENDIAN, _NATIVE64):
        looks = [_look_at(pathlib.Path(f"{base}{letter}"), layout) for letter in "rw"]
        blocks = sum(look.blocks for look in looks)
        possible = all(look.rank != _NO_TAPE for look in looks) and not (
            any(look.needs_other for look in looks) and blocks == 0
        )
        if possible:
            damaged = any(look.rank == _DAMAGED for look in looks)
            found.append(
                ((-blocks, damaged, sum(look.rank for look in looks), max(look.claims for look in looks)), layout)
            )
    if not found:
        raise Error(f"{base} is not a tape: its files are no blocks of either layout")
    return min(found, key=lambda each: each[0])[1]


def _open_to_read(path: pathlib.Path) -> BinaryIO:
    """A regular file: a FIFO without a writer is not waited for, a device not even opened."""
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise Error(f"{path} is not a regular file")
    file = os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC), "rb")
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):  # one has taken its place
        file.close()
        raise Error(f"{path} is not a regular file")
    return file


def _lock(path: pathlib.Path, held: contextlib.ExitStack) -> bool:
    """Whether a file is there, which is to be replaced and is locked until `held` ends: FORMAT.md, "Locks"."""
    try:
        file = os.open(path, os.O_WRONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    except PermissionError:
        # What we may not write has no lock of ours to take, and is replaced by the rights to its folder.
        if not stat.S_ISREG(os.lstat(path).st_mode):
            raise
        return True
    held.callback(os.close, file)
    if not stat.S_ISREG(os.fstat(file).st_mode):
        raise OSError(errno.EEXIST, "is not a regular file", os.fspath(path))
    try:
        fcntl.fcntl(file, _OFD_SETLK, struct.pack("@hhqqi0q", fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0))
    except OSError as error:
        if error.errno in (errno.EAGAIN, errno.EACCES):
            raise OSError(errno.EBUSY, "is being written by a recording", os.fspath(path)) from error
        if error.errno not in (errno.ENOLCK, errno.EINVAL, errno.EOPNOTSUPP, errno.ENOSYS):
            raise
    if not os.path.samestat(os.fstat(file), os.lstat(path)):
        raise OSError(errno.EEXIST, "has been replaced meanwhile", os.fspath(path))
    return True


def _give_name(made: pathlib.Path, final: pathlib.Path, overwrite: bool) -> None:
    """A second name, under which nothing was; on a file system without second names the only one."""
    try:
        os.link(made, final)
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK):
            raise
        if not overwrite:  # holds the name: nothing is replaced that was there
            os.close(os.open(final, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o640))
        os.replace(made, final)


class _Files:
    """Open files that close together."""

    def __init__(self) -> None:
        self._files: list[BinaryIO] = []

    def read(self, path: pathlib.Path) -> BinaryIO:
        self._files.append(_open_to_read(path))
        return self._files[-1]

    def make(self, path: pathlib.Path) -> BinaryIO:
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        self._files.append(open(os.open(path, flags, 0o640), "wb"))  # noqa: SIM115 - closed by close()
        return self._files[-1]

    def close(self) -> None:
        for file in self._files:
            file.close()
        self._files.clear()


class Reader:
    """A tape in its order: by time; of equal times events, then writes, then reads. Begins anew with each `for`.

    Raises Error where there is none, and while it is read Damage: also, once all was given, where there are not as many
    blocks and bytes as the tape's `end` tells of (digests are porttape verify's). `notes` tells of torn tails once they were met.
    """

    def __init__(self, name: str | os.PathLike[str]) -> None:
        self.path = find(name)
        self.notes: list[str] = []
        self._files = _Files()
        try:
            self._layout = _layout_of(self.path)
        except Error as error:
            if self._header() is not None:
                raise Damage(str(error)) from None
            raise
        self.header: dict[str, Any] | None = self._header()
        """Of the events file; None without one."""

    @property
    def layout(self) -> str:
        """`big-endian` or `native 64-bit`."""
        return self._layout.name

    def close(self) -> None:
        """Closes its files."""
        self._files.close()

    def __enter__(self) -> "Reader":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __iter__(self) -> Iterator[Item]:
        self.close()
        self.notes.clear()
        streams: list[Iterator[Item]] = [self._events(), self._blocks("w"), self._blocks("r")]
        heads = [next(stream, None) for stream in streams]
        end: Event | None = None
        held = {letter: {"blocks": 0, "bytes": 0} for letter in "rw"}
        while True:
            chosen = None
            for index, head in enumerate(heads):
                if head is not None and (chosen is None or head.t_us < heads[chosen].t_us):  # type: ignore[union-attr]
                    chosen = index
            if chosen is None:
                break
            head = heads[chosen]
            assert head is not None
            if isinstance(head, Event):
                end = head if head.kind == "end" else None
            else:
                held[head.direction]["blocks"] += 1
                held[head.direction]["bytes"] += len(head.data)
            yield head
            heads[chosen] = next(streams[chosen], None)
        told = {"r": _totals(end, "read"), "w": _totals(end, "write")}
        if None in told.values():
            return
        for letter in "rw":
            if told[letter] != held[letter]:
                raise Damage(
                    f"{self._file(letter)} is not what the tape's end tells of: it holds {held[letter]['blocks']} "
                    f"blocks, {held[letter]['bytes']} bytes; porttape verify says more"
                )

    def _file(self, letter: str) -> pathlib.Path:
        return pathlib.Path(f"{self.path}{letter}")

    def _header(self) -> dict[str, Any] | None:
        try:
            file = _open_to_read(self._file("e"))
        except FileNotFoundError:
            return None
        with file:
            line = file.readline(_LINE + 1)
        if not line.endswith(b"\n"):
            if len(line) >= _LINE:
                raise Damage(f"{self._file('e')} is no events file: its first line is too long")
            if _goes_on(line):
                raise Damage(f"{self._file('e')}: line 1 is damaged: something other than its end follows the line")
            return None  # torn
        header = _object(line)
        if header is None or header.get("format") != "porttape-events":
            raise Damage(f"{self._file('e')} is no events file: its first line is no porttape-events header")
        if _count(header, "version") != 1:
            raise Error(f"{self._file('e')} is no events file of version 1")
        return header

    def _blocks(self, letter: str) -> Iterator[Block]:
        path, layout = self._file(letter), self._layout
        try:
            file = self._files.read(path)
        except FileNotFoundError:
            return
        at, last_us = 0, 0
        while True:
            size = os.fstat(file.fileno()).st_size
            raw = file.read(layout.size)
            if not raw:
                return
            if len(raw) < layout.size:
                self.notes.append(f"{path}: an unfinished block at byte {at}, which does not count")
                return
            header = layout.header(raw)
            fault = layout.fault(header, last_us)
            if fault is not None:
                raise Damage(f"{path}: damaged at byte {at}: {fault}")
            last_us = header[0] * 1_000_000 + header[1]
            if at + layout.size + header[2] > size:
                if _blocks_follow(file, layout, at + layout.size, last_us, size):
                    raise Damage(f"{path}: damaged at byte {at}: a length of {header[2]} runs past the end of the file")
                self.notes.append(f"{path}: an unfinished block at byte {at}, which does not count")
                return
            at += layout.size + header[2]
            yield Block(last_us, letter, file.read(header[2]))

    def _events(self) -> Iterator[Event]:
        path = self._file("e")
        try:
            file = self._files.read(path)
        except FileNotFoundError:
            return
        number, last_us = 0, 0
        while True:
            line = file.readline(_LINE + 1)
            number += 1
            if not line:
                return
            if len(line) > _LINE or (len(line) == _LINE and not line.endswith(b"\n")):
                raise Damage(f"{path}: line {number} is damaged: longer than {_LINE} bytes")
            if not line.endswith(b"\n"):
                if _goes_on(line):
                    raise Damage(f"{path}: line {number} is damaged: something other than its end follows the line")
                self.notes.append(f"{path}: an unfinished line {number}, which does not count")
                return
            if number == 1:
                continue
            keys = _object(line)
            time = _count(keys, "t_us") if keys is not None else None
            kind = keys.get("event") if keys is not None else None
            if keys is None or time is None or not isinstance(kind, str) or not kind:
                raise Damage(f"{path}: line {number} is damaged: no event with t_us and event")
            if time >= _LATEST_EVENT_US:
                raise Damage(f"{path}: line {number} is damaged: t_us is later than any tape can be")
            del keys["t_us"], keys["event"]
            if time < last_us:
                raise Damage(f"{path}: line {number} is damaged: the time goes back, from {last_us} to {time} us")
            last_us = time
            yield Event(time, kind, keys)


def _whole_number(text: str) -> int | float:
    """As the program has it: one that no 64 bits hold is a float."""
    if len(text) > 20:
        return float(text)
    number = int(text)
    return number if -(1 << 63) <= number < 1 << 64 else float(number)


def _float(text: str) -> float:
    exponent = text.lower().partition("e")[2].lstrip("+-0")
    if len(exponent) > 10 or int(exponent or "0") > _MOST_EXPONENT:
        raise ValueError("an exponent that the program does not read")
    return float(text)


def _no_number(text: str) -> Any:
    raise ValueError(f"{text} is no JSON")


_DECODER = json.JSONDecoder(parse_int=_whole_number, parse_float=_float, parse_constant=_no_number)


def _is_sound(text: str) -> bool:
    """Whether all texts of some JSON are Unicode, also those that a later key replaces, and nothing is too deep."""
    depth = 0
    for match in _TOKEN.finditer(text):
        token = match[0]
        if token in ("[", "{"):
            depth += 1
            if depth > _DEEPEST:
                return False
        elif token in ("]", "}"):
            depth -= 1
        elif "\\u" in token:
            try:
                json.loads(token).encode("utf-8")
            except UnicodeEncodeError:  # half of a surrogate pair
                return False
    return True


def _object(line: bytes) -> dict[str, Any] | None:
    try:
        text = line.decode("utf-8", errors="replace")
        found = _DECODER.decode(text)
    except (ValueError, RecursionError):  # no JSON, or brackets a thousand deep
        return None
    return found if isinstance(found, dict) and _is_sound(text) else None


def _count(keys: dict[str, Any], key: str) -> int | None:
    """A whole number that is not negative, within 63 bits; else None."""
    number = keys.get(key)
    return number if type(number) is int and 0 <= number < 1 << 63 else None  # a bool is an int, too


def _totals(end: Event | None, file: str) -> dict[str, int] | None:
    """The blocks and bytes that an `end` tells of for one of the files."""
    told = end.keys.get(file) if end is not None else None
    if not isinstance(told, dict):
        return None
    blocks, size = _count(told, "blocks"), _count(told, "bytes")
    return None if blocks is None or size is None else {"blocks": blocks, "bytes": size}


def _goes_on(tail: bytes) -> bool:
    """Whether something follows a whole JSON value, other than the zeros of a machine that went down."""
    text = tail.decode("utf-8", errors="replace").lstrip(" \t\r\n")
    try:
        _, end = _DECODER.raw_decode(text)
    except (ValueError, RecursionError):
        return False
    rest = text[end:].lstrip(" \t\r\n")
    return _is_sound(text[:end]) and rest != "" and not rest.startswith("\0")


class Writer:
    """A new tape, which appears when it is closed without an exception: whole, or not at all.

    Times may be equal, and never go back within the reads, the writes or the events. `header` are further keys of the
    header; a tape that is there is replaced only with `overwrite`, and never while a recording writes it. Its files have the
    mode 0640 less the umask. Raises Error.
    """

    def __init__(
        self,
        name: str | os.PathLike[str],
        *,
        device: str = "",
        driver: str = "",
        header: dict[str, Any] | None = None,
        overwrite: bool = False,
    ) -> None:
        text = os.fspath(name)
        self.path = pathlib.Path(text if pathlib.PurePath(text).suffix else text + ".log")
        self._overwrite = overwrite
        if not overwrite:
            for letter in "rwe":
                if os.path.lexists(self._final(letter)):
                    raise Error(f"{self._final(letter)} exists; take another name, or overwrite=True")
        self._last = {"r": 0, "w": 0, "e": 0}
        self._totals = {letter: {"blocks": 0, "bytes": 0} for letter in "rw"}
        self._ended = False
        self._files = _Files()
        mark = secrets.token_hex(4)
        self._names = {
            letter: self.path.with_name(f".{self.path.name}{letter}.new-{os.getpid()}-{mark}") for letter in "rwe"
        }
        self._open: dict[str, BinaryIO] = {}
        try:
            for letter, path in self._names.items():
                self._open[letter] = self._files.make(path)
        except OSError as error:
            self.discard()
            raise Error(f"cannot make the tape {self.path}: {error}") from error
        first: dict[str, Any] = {"format": "porttape-events", "version": 1}
        first["created"] = datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        first["id"] = secrets.token_hex(16)
        first.update({key: value for key, value in (("device", device), ("driver", driver)) if value})
        first.update({"host": socket.gethostname(), "tool": "porttape.tape"})
        first.update(header or {})
        self._line(first)

    def read(self, t_us: int, data: bytes) -> None:
        """What the device sent."""
        self._block("r", t_us, data)

    def write(self, t_us: int, data: bytes) -> None:
        """What the driver wrote."""
        self._block("w", t_us, data)

    def event(self, t_us: int, kind: str, **keys: Any) -> None:
        """An event of that kind; `end` is close()'s."""
        self._line({"t_us": self._time("e", t_us), "event": kind, **keys})

    def add(self, item: Item) -> None:
        """What a Reader gives. An `end` is left out."""
        if isinstance(item, Block):
            self._block(item.direction, item.t_us, item.data)
        elif item.kind != "end":
            self._line({"t_us": self._time("e", item.t_us), "event": item.kind, **item.keys})

    def close(self) -> None:
        """Ends the tape and gives it its name."""
        if self._ended:
            return
        behind = min(max(self._last["r"], self._last["w"]) + 1, _MOST_US)  # the last block
        end: dict[str, Any] = {"t_us": max(self._last["e"], behind), "event": "end"}
        end.update({"read": self._totals["r"], "write": self._totals["w"]})
        try:
            self._line(end)
            for file in self._open.values():
                file.flush()
                os.fsync(file.fileno())
            self._files.close()
            self._publish()
        except OSError as error:
            self.discard()
            raise Error(f"cannot make the tape {self.path}: {error}") from error
        self._ended = True

    def discard(self) -> None:
        """Leaves nothing of a tape that is not closed."""
        self._ended = True
        self._files.close()
        for letter in self._open:
            self._names[letter].unlink(missing_ok=True)

    def __enter__(self) -> "Writer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        elif not self._ended:
            self.discard()

    def _final(self, letter: str) -> pathlib.Path:
        return pathlib.Path(f"{self.path}{letter}")

    def _publish(self) -> None:
        """The events first: who finds the blocks finds them, too. Of files that had no namesakes all appear, or none."""
        with contextlib.ExitStack() as held:
            replaced = [letter for letter in "rwe" if self._overwrite and _lock(self._final(letter), held)]
            try:
                for letter in "ewr":
                    if letter not in replaced:
                        _give_name(self._names[letter], self._final(letter), self._overwrite)
                for letter in reversed(replaced):
                    os.replace(self._names[letter], self._final(letter))
            except BaseException:
                for letter in "ewr":
                    with contextlib.suppress(FileNotFoundError):
                        if os.path.samestat(os.lstat(self._names[letter]), os.lstat(self._final(letter))):
                            self._final(letter).unlink()
                raise
            for path in self._names.values():
                path.unlink(missing_ok=True)

    def _time(self, letter: str, t_us: int) -> int:
        if self._ended:
            raise Error(f"the tape {self.path} is closed")
        if not 0 <= t_us <= _MOST_US:
            raise Error(f"a tape has no room for the time {t_us} us")
        if t_us < self._last[letter]:
            raise Error(f"the time goes back, from {self._last[letter]} to {t_us} us, which a tape cannot hold")
        self._last[letter] = t_us
        return t_us

    def _block(self, letter: str, t_us: int, data: bytes) -> None:
        if len(data) > 0xFFFFFFFF:
            raise Error(f"a block of {len(data)} bytes, beyond 32 bits")
        at = self._time(letter, t_us)
        self._open[letter].write(_BIG_ENDIAN.form.pack(at // 1_000_000, at % 1_000_000, len(data)) + data)
        self._totals[letter]["blocks"] += 1
        self._totals[letter]["bytes"] += len(data)

    def _line(self, keys: dict[str, Any]) -> None:
        line = json.dumps(keys, ensure_ascii=False, separators=(",", ":")).encode("utf-8", errors="replace") + b"\n"
        if len(line) > _LINE:
            raise Error(f"an event of {len(line)} bytes; an events file's lines have at most {_LINE}")
        found = _object(line)
        if found is None or ("event" in keys and (_count(found, "t_us") is None or not found["event"])):
            raise Error("porttape could not read this line: it has NaN, no kind, an odd time or too many brackets")
        self._open["e"].write(line)
