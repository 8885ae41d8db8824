#!/usr/bin/env python3
"""What porttape.tape reads and writes is what the program reads and writes."""

import json
import os
import pathlib
import random
import struct
import subprocess
import tempfile
import unittest

from porttape import tape

PORTTAPE = os.environ["PORTTAPE"]
SAMPLES = pathlib.Path(os.environ["SAMPLES"])
RECORDINGS = pathlib.Path(os.environ["SHARED"]) / "recordings"


def cat(name):
    """The tape as the program has it, and its exit status."""
    done = subprocess.run([PORTTAPE, "cat", "--json", "--blocks", name], capture_output=True, text=True, check=False)
    items = []
    for line in done.stdout.splitlines():
        keys = json.loads(line)
        if "event" in keys:
            items.append(tape.Event(keys.pop("t_us"), keys.pop("event"), keys))
        else:
            items.append(tape.Block(keys["t_us"], keys["dir"], bytes.fromhex(keys["hex"])))
    return items, done.returncode


def in_python(name):
    """The same by the module."""
    items = []
    try:
        with tape.Reader(name) as reader:
            for item in reader:
                items.append(item)
    except tape.Damage:
        return items, 1
    except tape.Error:
        return items, 2
    return items, 0


def random_items(choose):
    """Blocks and events in a tape's order."""
    now, items = 0, []
    for _ in range(choose.randrange(1, 60)):
        now += choose.choice((0, 0, choose.randrange(600), choose.randrange(3_000_000)))
        kind = choose.randrange(5)
        if kind == 0:
            keys = {"text": choose.choice(("a", "ä\n\"", "\u2028")), "deep": [1, {"x": None}]}
            items.append(tape.Event(now, choose.choice(("mark", "snow")), keys))
        else:
            items.append(tape.Block(now, "rw"[kind % 2], choose.randbytes(choose.choice((0, 1, 7, 300)))))
    def place(item):
        return item.t_us, 0 if isinstance(item, tape.Event) else 1 + "wr".index(item.direction)

    return sorted(items, key=place)


class TapeTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def test_real_tapes(self):
        tapes = [path.with_name(path.name[:-1]) for path in sorted(SAMPLES.glob("*.logr"))]
        self.assertGreaterEqual(len(tapes), 5)
        tapes += [path.with_name(path.name[:-1]) for path in sorted(RECORDINGS.glob("*r"))]
        for path in tapes:
            with self.subTest(path.name):
                wanted, status = cat(path)
                self.assertEqual(status, 0)
                self.assertEqual(in_python(path), (wanted, 0))

    def test_what_is_written_is_read_by_both(self):
        choose = random.Random(20260101)
        for number in range(40):
            items = random_items(choose)
            name = self.folder / f"made{number}"
            with tape.Writer(name, device="serial:/dev/x", header={"colour": "red"}) as made:
                for item in items:
                    made.add(item)
            seen, status = cat(name)
            self.assertEqual(status, 0)
            self.assertEqual(seen[:-1], items)
            self.assertEqual(in_python(name), (seen, 0))
            verified = subprocess.run([PORTTAPE, "verify", name], capture_output=True, text=True, check=False)
            self.assertEqual(verified.returncode, 0, verified.stdout + verified.stderr)
            with tape.Reader(name) as reader:
                self.assertEqual((reader.header["colour"], reader.header["device"]), ("red", "serial:/dev/x"))

    def test_the_older_layout(self):
        blocks = [(0, 93, b"Message #1"), (3, 4, b"x" * 300), (3, 4, b"")]
        data = b"".join(struct.pack("<qqQ", s, us, len(d)) + d for s, us, d in blocks)
        (self.folder / "old.logr").write_bytes(data)
        wanted = [tape.Block(s * 1_000_000 + us, "r", d) for s, us, d in blocks]
        self.assertEqual(in_python(self.folder / "old"), (wanted, 0))
        self.assertEqual(cat(self.folder / "old"), (wanted, 0))
        with tape.Reader(self.folder / "old") as reader:
            self.assertEqual((reader.layout, reader.header), ("native 64-bit", None))

    def test_damage_and_torn_tails_as_the_program_has_them(self):
        choose = random.Random(7)
        with tape.Writer(self.folder / "whole") as made:
            for item in [tape.Block(i * 1000, "rw"[i % 2], choose.randbytes(20)) for i in range(60)]:
                made.add(item)
        whole = {letter: (self.folder / f"whole.log{letter}").read_bytes() for letter in "rwe"}
        seen = dict.fromkeys(range(3), 0)
        for number in range(120):
            letter = choose.choice("rwe")
            data = bytearray(whole[letter])
            if number % 3 == 0:
                del data[choose.randrange(len(data)) :]
            else:
                data[choose.randrange(len(data))] = choose.randrange(256)
            for other in "rwe":
                (self.folder / f"hurt.log{other}").write_bytes(data if other == letter else whole[other])
            with self.subTest(number=number, letter=letter):
                items, status = in_python(self.folder / "hurt")
                wanted, expected = cat(self.folder / "hurt")
                # Of an events file that is none cat still shows the blocks.
                self.assertEqual(status, 2 if letter == "e" and expected == 1 and status == 2 else expected)
                if expected == 0:
                    self.assertEqual(items, wanted)
                seen[status] += 1
        self.assertTrue(seen[0] > 10 and seen[1] > 10, seen)

    def test_unfinished_blocks_as_the_format_has_them(self):
        def block(second, data, length=None):
            return struct.pack(">III", second, 0, len(data) if length is None else length) + data

        early = block(100, block(50, b"no block of this chain"), 1000)
        cases = {
            "a chain that begins before the block with the long length": (block(5, b"a") + early, b""),
            "a chain behind it": (block(5, b"a") + block(100, block(150, b"of the chain"), 1000), b""),
            "up to eight bytes that do not begin with 0": (b"\1\2\3\4\5", b""),
            "the same beside a block": (b"\1\2\3\4\5", block(1, b"b")),
            "three bytes that begin with 0": (b"\0\0\1", b""),
            "microseconds that cannot be": (b"\0\0\0\1\xff\xff\xff", b""),
        }
        for name, (read, write) in cases.items():
            (self.folder / "odd.logr").write_bytes(read)
            (self.folder / "odd.logw").write_bytes(write)
            with self.subTest(name):
                self.assertEqual(in_python(self.folder / "odd"), cat(self.folder / "odd"))

    def test_a_tape_appears_whole_or_not_at_all(self):
        made = tape.Writer(self.folder / "new.log")
        made.read(5, b"a")
        self.assertEqual([path for path in self.folder.iterdir() if not path.name.startswith(".")], [])
        with self.assertRaisesRegex(tape.Error, "the time goes back, from 5 to 4 us"):
            made.read(4, b"b")
        made.discard()
        self.assertEqual(list(self.folder.iterdir()), [])
        with self.assertRaises(KeyError):
            with tape.Writer(self.folder / "new.log"):
                raise KeyError
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_a_name_that_is_taken(self):
        with tape.Writer(self.folder / "one"):
            pass
        with self.assertRaisesRegex(tape.Error, "exists; take another name"):
            tape.Writer(self.folder / "one")
        with tape.Writer(self.folder / "one", overwrite=True) as made:
            made.write(1, b"new")
        self.assertEqual(in_python(self.folder / "one")[0][0], tape.Block(1, "w", b"new"))
        first, second = tape.Writer(self.folder / "two"), tape.Writer(self.folder / "two")
        first.close()
        with self.assertRaisesRegex(tape.Error, "cannot make the tape"):
            second.close()
        self.assertEqual(len(list(self.folder.iterdir())), 6)

    def test_no_tape(self):
        with self.assertRaisesRegex(tape.Error, "there is no tape"):
            tape.Reader(self.folder / "nothing")
        (self.folder / "text.logr").write_text("this is no tape at all, but some text of a few words")
        with self.assertRaisesRegex(tape.Error, "is not a tape"):
            tape.Reader(self.folder / "text")
        with self.assertRaisesRegex(tape.Error, "cannot make the tape"):
            tape.Writer(self.folder / "no folder" / "x")


class OfAStranger(unittest.TestCase):
    """What is no tape, made to hold its reader up."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.tape = pathlib.Path(folder.name) / "t.log"
        (self.tape.parent / "t.logw").write_bytes(struct.pack(">III", 0, 1, 1) + b"x")

    def file(self, letter):
        return pathlib.Path(f"{self.tape}{letter}")

    def test_a_fifo_or_a_device_is_not_waited_for(self):
        for letter in "re":
            os.mkfifo(self.file(letter))
            with self.assertRaisesRegex(tape.Error, "is not a regular file"):
                list(tape.Reader(self.tape))
            self.file(letter).unlink()
            self.file(letter).symlink_to("/dev/null")
            with self.assertRaisesRegex(tape.Error, "is not a regular file"):
                list(tape.Reader(self.tape))
            self.file(letter).unlink()

    def test_deep_json_is_damage(self):
        header = b'{"format":"porttape-events","version":1}\n'
        deep = b'{"t_us":0,"event":"mark","text":' + b"[" * 20_000 + b"]" * 20_000 + b"}\n"
        self.file("e").write_bytes(header + deep)
        with self.assertRaisesRegex(tape.Damage, "line 2 is damaged"):
            list(tape.Reader(self.tape))
        self.file("e").write_bytes(deep)
        with self.assertRaisesRegex(tape.Damage, "no porttape-events header"):
            list(tape.Reader(self.tape))


if __name__ == "__main__":
    if not RECORDINGS.is_dir():
        print("python.tape: without ../shared/recordings, which are not here")
    unittest.main()
