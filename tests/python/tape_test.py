#!/usr/bin/env python3
"""What porttape.tape reads and writes is what the program reads and writes."""

import fcntl
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

    def test_a_tape_is_for_its_owner_and_the_group(self):
        before = os.umask(0o022)
        try:
            with tape.Writer(self.folder / "new"):
                pass
        finally:
            os.umask(before)
        self.assertEqual({(self.folder / f"new.log{letter}").stat().st_mode & 0o777 for letter in "rwe"}, {0o640})

    def test_what_could_not_be_read_is_not_written(self):
        deep = []
        for _ in range(40):
            deep = [deep]
        with tape.Writer(self.folder / "odd") as made:
            for t_us, kind, keys in ((1, "mark", {"x": float("nan")}), (1, "", {}), (1.5, "mark", {}), (2, "mark", {"x": deep})):
                with self.assertRaisesRegex(tape.Error, "porttape could not read this line"):
                    made.event(t_us, kind, **keys)
        self.assertEqual(cat(self.folder / "odd")[1], 0)

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

    def test_a_tape_that_is_being_written_is_not_replaced(self):
        with tape.Writer(self.folder / "live") as made:
            made.write(1, b"old")
        with open(self.folder / "live.loge", "r+b") as recorder:
            lock = struct.pack("@hhqqi0q", fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
            fcntl.fcntl(recorder, 37, lock)  # F_OFD_SETLK
            new = tape.Writer(self.folder / "live", overwrite=True)
            with self.assertRaisesRegex(tape.Error, "is being written by a recording"):
                new.close()
        self.assertEqual(in_python(self.folder / "live")[0][0], tape.Block(1, "w", b"old"))
        self.assertEqual(len(list(self.folder.iterdir())), 3)

    def test_where_one_name_is_taken_by_now_no_file_of_the_tape_appears(self):
        made = tape.Writer(self.folder / "new")
        (self.folder / "new.logr").write_bytes(b"precious")
        with self.assertRaisesRegex(tape.Error, "cannot make the tape"):
            made.close()
        self.assertEqual([path.name for path in self.folder.iterdir()], ["new.logr"])
        self.assertEqual((self.folder / "new.logr").read_bytes(), b"precious")

    def test_no_tape(self):
        with self.assertRaisesRegex(tape.Error, "there is no tape"):
            tape.Reader(self.folder / "nothing")
        (self.folder / "text.logr").write_text("this is no tape at all, but some text of a few words")
        with self.assertRaisesRegex(tape.Error, "is not a tape"):
            tape.Reader(self.folder / "text")
        with self.assertRaisesRegex(tape.Error, "cannot make the tape"):
            tape.Writer(self.folder / "no folder" / "x")


class EveryLineAlike(unittest.TestCase):
    """Both readers judge the lines of an events file alike."""

    HEADER = b'{"format":"porttape-events","version":1}\n'
    LINES = {
        "sound": b'{"t_us":5,"event":"mark","text":"a"}',
        "an unknown kind": b'{"t_us":5,"event":"snow"}',
        "an empty kind": b'{"t_us":5,"event":""}',
        "no kind": b'{"t_us":5}',
        "a kind that is a number": b'{"t_us":5,"event":1}',
        "a kind that is null": b'{"t_us":5,"event":null}',
        "a kind with half a surrogate pair": b'{"t_us":5,"event":"a\\ud800"}',
        "a kind with the other half": b'{"t_us":5,"event":"a\\udc00b"}',
        "a kind with a whole pair": b'{"t_us":5,"event":"a\\ud83d\\ude00"}',
        "half a pair in a text": b'{"t_us":5,"event":"mark","text":"\\ud800"}',
        "half a pair deeper": b'{"t_us":5,"event":"mark","x":[{"y":"\\ud800"}]}',
        "half a pair in a key": b'{"t_us":5,"event":"mark","\\udfff":1}',
        "half a pair in a value that is replaced": b'{"t_us":5,"event":"\\ud800","event":"mark"}',
        "bytes that are no UTF-8": b'{"t_us":5,"event":"mark","text":"\xff\xed\xa0\x80"}',
        "a kind that is no UTF-8": b'{"t_us":5,"event":"a\xff"}',
        "an escaped zero": b'{"t_us":5,"event":"a\\u0000b"}',
        "a byte 0": b'{"t_us":5,"event":"a\0b"}',
        "a tab": b'{"t_us":5,"event":"a\tb"}',
        "DEL": b'{"t_us":5,"event":"a\x7fb"}',
        "a false escape": b'{"t_us":5,"event":"a\\x"}',
        "a keyword of another language": b'{"t_us":5,"event":"mark","x":None}',
        "no time": b'{"event":"mark"}',
        "a time that is true": b'{"t_us":true,"event":"mark"}',
        "a time that is a text": b'{"t_us":"5","event":"mark"}',
        "a time that is null": b'{"t_us":null,"event":"mark"}',
        "a time with a fraction": b'{"t_us":5.0,"event":"mark"}',
        "a time with an exponent": b'{"t_us":5e0,"event":"mark"}',
        "a negative time": b'{"t_us":-1,"event":"mark"}',
        "minus nothing": b'{"t_us":-0,"event":"mark"}',
        "a leading zero": b'{"t_us":05,"event":"mark"}',
        "a plus": b'{"t_us":+5,"event":"mark"}',
        "the latest time": b'{"t_us":9223372036854775806,"event":"mark"}',
        "later than the latest time": b'{"t_us":9223372036854775807,"event":"mark"}',
        "beyond 63 bits": b'{"t_us":9223372036854775808,"event":"mark"}',
        "beyond 64 bits": b'{"t_us":18446744073709551616,"event":"mark"}',
        "the second time counts": b'{"t_us":"x","event":"mark","t_us":5}',
        "the second time counts against it": b'{"t_us":5,"event":"mark","t_us":"x"}',
        "the second kind counts": b'{"t_us":5,"event":1,"event":"mark"}',
        "NaN": b'{"t_us":5,"event":"mark","x":NaN}',
        "Infinity": b'{"t_us":5,"event":"mark","x":[-Infinity]}',
        "a large exponent": b'{"t_us":5,"event":"mark","x":1e400}',
        "a small exponent": b'{"t_us":5,"event":"mark","x":1e-400}',
        "a very large exponent": b'{"t_us":5,"event":"mark","x":1e99999999999}',
        "the largest exponent": b'{"t_us":5,"event":"mark","x":1e2147483647}',
        "one more": b'{"t_us":5,"event":"mark","x":1e2147483648}',
        "a very small exponent": b'{"t_us":5,"event":"mark","x":1.5E-02147483640}',
        "a smaller one": b'{"t_us":5,"event":"mark","x":1.5E-02147483648}',
        "depth that is replaced": b'{"t_us":5,"x":' + b"[" * 32 + b"]" * 32 + b',"x":1,"event":"mark"}',
        "brackets in a text": b'{"t_us":5,"event":"mark","x":"' + b'[{\\"' * 40 + b'"}',
        "many digits": b'{"t_us":5,"event":"mark","x":' + b"7" * 5000 + b"}",
        "as deep as it may be": b'{"t_us":5,"event":"mark","x":' + b"[" * 31 + b"]" * 31 + b"}",
        "a text as deep as it may be": b'{"t_us":5,"event":"mark","x":' + b"[" * 31 + b'"a"' + b"]" * 31 + b"}",
        "one too deep": b'{"t_us":5,"event":"mark","x":' + b"[" * 32 + b"]" * 32 + b"}",
        "objects, one too deep": b'{"t_us":5,"event":"mark","x":' + b'{"x":' * 32 + b"1" + b"}" * 33,
        "a list": b'[{"t_us":5,"event":"mark"}]',
        "a number": b"5",
        "nothing": b"",
        "white space around": b' \t{ "t_us" : 5 , "event" : "mark" } \r',
        "other white space": b'\x0c{"t_us":5,"event":"mark"}',
        "a space of Unicode": b'{"t_us":5,"event":"mark"}\xc2\xa0',
        "a mark of byte order": b'\xef\xbb\xbf{"t_us":5,"event":"mark"}',
        "two objects": b'{"t_us":5,"event":"mark"}{}',
        "a comma at the end": b'{"t_us":5,"event":"mark",}',
        "a comment": b'{"t_us":5,"event":"mark"} // no',
        "an end with odd totals": b'{"t_us":5,"event":"end","read":{"blocks":-1,"bytes":0},"write":{"blocks":true,"bytes":1}}',
        "an end with floats": b'{"t_us":5,"event":"end","read":{"blocks":7.0,"bytes":0}}',
        "an end with half of the totals": b'{"t_us":5,"event":"end","read":{"blocks":7}}',
        "an end without the other file's": b'{"t_us":5,"event":"end","read":{"blocks":7,"bytes":0}}',
        "an end with right totals": b'{"t_us":5,"event":"end","read":{"blocks":0,"bytes":0},"write":{"blocks":1,"bytes":1}}',
        "an end with other totals": b'{"t_us":5,"event":"end","read":{"blocks":7,"bytes":0},"write":{"blocks":1,"bytes":1}}',
        "an end with one odd total": b'{"t_us":5,"event":"end","read":{"blocks":7,"bytes":0},"write":{"blocks":1,"bytes":1.0}}',
    }
    HEADERS = {
        "sound": b'{"format":"porttape-events","version":1}',
        "with odd keys": b'{"format":"porttape-events","version":1,"id":7,"device":null,"zero":[]}',
        "a version that is true": b'{"format":"porttape-events","version":true}',
        "a version with a fraction": b'{"format":"porttape-events","version":1.0}',
        "another version": b'{"format":"porttape-events","version":2}',
        "a text as version": b'{"format":"porttape-events","version":"1"}',
        "no version": b'{"format":"porttape-events"}',
        "the second version counts": b'{"format":"porttape-events","version":2,"version":1}',
        "another format": b'{"format":"porttape","version":1}',
        "a list as format": b'{"format":["porttape-events"],"version":1}',
        "half a pair": b'{"format":"porttape-events","version":1,"device":"\\ud800"}',
        "NaN": b'{"format":"porttape-events","version":1,"x":NaN}',
    }
    TAILS = {
        "cut off": b'{"t_us":5,"event":"ma',
        "whole without its end": b'{"t_us":5,"event":"mark"}',
        "white space behind": b'{"t_us":5,"event":"mark"} \r',
        "zeros behind": b'{"t_us":5,"event":"mark"}\0\0\0',
        "zeros alone": b"\0\0\0",
        "more behind": b'{"t_us":5,"event":"mark"}{"t_us":6',
        "a letter behind": b'{"t_us":5,"event":"mark"} x',
        "no JSON": b"xyz",
        "as long as a line": b'{"t_us":5,"event":"' + b"m" * (65536 - 19),
        "one less": b'{"t_us":5,"event":"' + b"m" * (65535 - 19),
    }

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.tape = pathlib.Path(folder.name) / "t.log"
        (self.tape.parent / "t.logw").write_bytes(struct.pack(">III", 0, 1, 1) + b"x")
        (self.tape.parent / "t.logr").write_bytes(b"")

    def judged(self, events):
        """Whether the program and the module take a tape with these events for sound."""
        (self.tape.parent / "t.loge").write_bytes(events)
        verified = subprocess.run([PORTTAPE, "verify", self.tape], capture_output=True, check=False)
        return verified.returncode == 0, in_python(self.tape)[1] == 0

    def check(self, table, make):
        for name, line in table.items():
            with self.subTest(name):
                program, module = self.judged(make(line))
                self.assertEqual(module, program)

    def test_lines(self):
        self.check(self.LINES, lambda line: self.HEADER + line + b"\n")

    def test_headers(self):
        self.check(self.HEADERS, lambda line: line + b"\n")

    def test_unfinished_lines(self):
        self.check(self.TAILS, lambda line: self.HEADER + line)

    def test_unfinished_headers(self):
        self.check(self.TAILS, lambda line: line)

    def test_both_kinds_are_there(self):
        lines = [self.judged(self.HEADER + line + b"\n")[0] for line in self.LINES.values()]
        self.assertTrue(lines.count(True) > 10 and lines.count(False) > 10, lines)


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
