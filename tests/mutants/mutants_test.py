#!/usr/bin/python3
"""mutants_test.py COMPILER: each kind of mutant on sample.cpp, and equivalent.list against the sources."""

import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(HERE))

try:
    import places
except ImportError:
    print("mutants.kinds: skipped: python3-clang is not installed; ./check does that")
    sys.exit(77)
import equivalent  # noqa: E402
import trial  # noqa: E402

COMPILER = sys.argv.pop(1) if len(sys.argv) > 1 else "c++"
SAMPLE = HERE / "sample.cpp"
SOURCE = SAMPLE.read_text(encoding="utf-8")


def places_of(source):
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "source.cpp"
        path.write_text(source, encoding="utf-8")
        return places.find("source.cpp", str(path), ["-std=c++20"])[0]


class KindsOnASample(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.places, _ = places.find("sample.cpp", str(SAMPLE), ["-std=c++20"])
        source = pathlib.Path(cls.folder.name) / "sample.cpp"
        source.write_bytes(b'#include "tests/mutants/switch.hpp"\n#line 1 "sample.cpp"\n'
                           + places.rewritten(SAMPLE.read_bytes(), list(enumerate(cls.places, 1))))
        for name, sources in (("plain", [SAMPLE]), ("mutants", [source, HERE / "switch.cpp"])):
            done = subprocess.run([COMPILER, "-std=c++20", "-w", f"-I{ROOT}", "-o", f"{cls.folder.name}/{name}", *sources],
                                  stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def run_sample(self, program="mutants", mutant=None, reached=None):
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PORTTAPE_MUTANT")}
        if mutant is not None:
            environment["PORTTAPE_MUTANT"] = str(mutant)
        if reached is not None:
            environment["PORTTAPE_MUTANT_REACHED"] = str(reached)
        try:
            done = subprocess.run([f"{self.folder.name}/{program}"], env=environment, stdin=subprocess.DEVNULL, timeout=1,
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
        except subprocess.TimeoutExpired:
            return "it hangs"
        return done.returncode, done.stdout

    def test_without_a_mutant_the_program_is_as_it_was(self):
        self.assertEqual(self.run_sample("plain"), self.run_sample())
        self.assertEqual(self.run_sample("plain"), self.run_sample(mutant=0))

    def test_each_mutant_changes_what_the_program_does(self):
        plain = self.run_sample("plain")
        same = [str(place) for number, place in enumerate(self.places, 1) if self.run_sample(mutant=number) == plain]
        self.assertEqual(same, [])

    def test_each_kind_is_there(self):
        self.assertEqual({place.kind for place in self.places}, set(places.KINDS))

    def test_what_is_reached_is_noted_in_the_file(self):
        reached = pathlib.Path(self.folder.name) / "reached"
        reached.write_bytes(bytes(len(self.places) + 1))
        self.run_sample(reached=reached)
        marks = reached.read_bytes()
        self.assertEqual([str(place) for number, place in enumerate(self.places, 1) if not marks[number]], [])
        self.assertEqual(marks[0], 0)

    def test_there_is_none_where_none_may_be(self):
        lines = {place.line for place in self.places}
        for number, text in enumerate(SOURCE.split("\n"), 1):
            if any(each in text for each in ("log.debug", "constexpr", "static_assert", "case ", "int sizes[")):
                self.assertNotIn(number, {line for line in lines if "return" not in text}, text)


class Changes(unittest.TestCase):
    def changes(self, body, kind):
        return [place.change for place in places_of(f"int f(int, int); bool g(int a, int b) {{ {body} }}")
                if place.kind == kind]

    def test_numbers(self):
        for text, changed in (("0", "1"), ("1", "0"), ("16", "17"), ("17u", "34u"), ("0xff", "0x100"), ("017", "020"),
                              ("0b11", "0b100"), ("1'000", "2000")):
            self.assertEqual(places.increased(text), changed)

    def test_a_part_of_a_condition_is_forced_both_ways(self):
        self.assertEqual(self.changes("return a && b;", "always"), ['"a" is true', '"b" is true'])
        self.assertEqual(self.changes("return a && b;", "never"), ['"a" is false', '"b" is false'])

    def test_a_loop_is_not_run_but_never_made_endless_on_purpose(self):
        self.assertEqual(self.changes("while (f(a, 1)) ++a; return true;", "always"), [])

    def test_the_last_statements_of_their_blocks_stay(self):
        self.assertEqual(self.changes("for (;;) { f(a, b); continue; } switch (a) { case 1: f(a, b); break; }", "left-out"),
                         ['without "f(a, b)"', 'without "f(a, b)"'])

    def test_equal_arguments_are_not_exchanged(self):
        self.assertEqual(self.changes("return f(a, a);", "exchanged"), [])


class Judging(unittest.TestCase):
    OUTPUT = "[ RUN      ] A.B\n[       OK ] A.B (0 ms)\n[ RUN      ] A.C/1\n"

    def test_the_failed_test_is_named(self):
        failed = self.OUTPUT + "[  FAILED  ] A.C/1, where GetParam() = 4 (0 ms)\n[  FAILED  ] 1 test, listed below:\n"
        self.assertEqual(trial.failed_tests(failed), "A.C/1")

    def test_of_a_crash_it_is_the_last_that_began(self):
        self.assertEqual(trial.failed_tests(self.OUTPUT), "A.C/1")

    def test_the_own_room_comes_first_and_fast_before_slow(self):
        tests = [trial.Test("session", "s", "S.fast", "/", {}, 0.01), trial.Test("port", "p", "P.quick", "/", {}, 1.0),
                 trial.Test("port", "p", "P.fast", "/", {}, 0.01), trial.Test("port", "p", "P.last", "/", {}, 3.0),
                 trial.Test("session", "s", "S.not", "/", {}, 3.0)]
        self.assertEqual([[test.name for test in some] for _, some in trial.batches("port", tests)],
                         [["P.fast"], ["P.quick"], ["S.fast"], ["P.last"]])

    def test_scripts_are_tried_last_of_all_and_the_one_that_reaches_the_least_first(self):
        wide = trial.Test("e2e", "/s/wide.sh", "e2e.wide", "/", {}, 1, frozenset({1, 2, 3}), ("a", "b"))
        narrow = trial.Test("e2e", "/s/narrow.sh", "e2e.narrow", "/", {}, 2, frozenset({1}))
        unit = trial.Test("tools", "/t", "T.t", "/", {}, 0.1, frozenset({1}))
        ran = []

        class Answers:
            def __init__(self, statuses):
                self.statuses = statuses

            def run(self, command, *_, **__):
                ran.append(os.path.basename(command[0]))
                return {"status": self.statuses.get(ran[-1], 0), "late": False, "seconds": 1, "output": ""}

        def judged(room, number, statuses):
            ran.clear()
            return trial.judge(Answers(statuses), number, room, [wide, unit, narrow], ("simulate", 1, 1, frozenset()))

        verdict = judged("tools", 1, {})
        self.assertEqual((ran, verdict.found, verdict.by), (["t", "narrow.sh", "wide.sh"], False,
                                                            "reached by 1 tests and 2 scripts"))
        verdict = judged("tools", 2, {"wide.sh": 1})
        self.assertEqual((ran, verdict.found, verdict.by), (["wide.sh", "wide.sh"], True, "e2e.wide"))
        verdict = judged("tools", 2, {"wide.sh": trial.SKIPPED})
        self.assertFalse(verdict.found)
        verdict = judged("port", 1, {"narrow.sh": 1})
        self.assertEqual((ran, verdict.found, verdict.by), (["t"], False, "reached by 1 tests"))
        self.assertEqual(wide.command, ["/s/wide.sh", "a", "b"])
        self.assertEqual(unit.command, ["/t", "--gtest_filter=T.t"])


class WhereTestsRun(unittest.TestCase):
    def run_script(self, private, script):
        worker = trial.Worker(private)
        try:
            return worker.run(["/bin/sh", "-c", script], "/", 60)
        finally:
            worker.stop()

    def each_way(self):
        yield False
        if trial.Workers(1).private:
            yield True

    def test_nothing_is_left_running(self):
        for private in self.each_way():
            with self.subTest(private=private):
                told = self.run_script(private, "setsid sleep 98765 & echo $PORTTAPE_MUTANT; exit 3")
                self.assertEqual((told["status"], told["late"], told["output"]), (3, False, "0\n"))
                found = subprocess.run(["pgrep", "-f", "^sleep 98765$"], stdout=subprocess.PIPE, text=True, check=False)
                self.assertEqual(found.stdout, "")

    def test_what_hangs_is_ended(self):
        for private in self.each_way():
            with self.subTest(private=private):
                worker = trial.Worker(private)
                try:
                    self.assertTrue(worker.run(["/bin/sh", "-c", "sleep 98766"], "/", 0.2)["late"])
                    self.assertEqual(worker.run(["/bin/true"], "/", 60)["status"], 0)
                finally:
                    worker.stop()

    def test_the_file_systems_are_safe(self):
        if not trial.Workers(1).private:
            print("mutants.kinds: skipped: only root has private namespaces")
            return
        told = self.run_script(True, f"touch '{HERE}/touched' /dev/touched /etc/touched || echo $TMPDIR; touch $TMPDIR/a")
        self.assertEqual(told["status"], 0)
        self.assertIn("/tmp/scratch", told["output"])
        for path in (HERE, pathlib.Path("/dev"), pathlib.Path("/etc")):
            self.assertFalse((path / "touched").exists())


class TheListOfEquivalentMutants(unittest.TestCase):
    """Whether each entry is still a mutant takes the syntax tree: `run --check-list`."""

    def test_each_entry_is_still_in_its_source(self):
        for entry in equivalent.read(HERE / "equivalent.list"):
            lines = [line.strip() for line in (ROOT / entry.file).read_text(encoding="utf-8").splitlines()]
            self.assertIn(entry.line, lines, f"{entry.file} has no such line")
            self.assertIn(entry.kind, places.KINDS)
            self.assertGreater(len(entry.reason), 20, f"{entry.line}: the reason is too short to be one")

    def test_no_entry_is_there_twice(self):
        entries = [(entry.file, entry.line, entry.kind, entry.change) for entry in equivalent.read(HERE / "equivalent.list")]
        self.assertEqual(len(entries), len(set(entries)))

    def test_an_entry_is_read_as_it_is_written(self):
        place = places_of("int f() { return 40; }")[0]
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "list"
            path.write_text("# a comment\n\n" + equivalent.entry_of(place) + "It is a sample.\n", encoding="utf-8")
            entry, = equivalent.read(path)
            self.assertTrue(entry.matches(place))
            self.assertEqual(entry.reason, "It is a sample.")
            path.write_text("a.cpp\n  line: x\n", encoding="utf-8")
            self.assertRaises(equivalent.BadList, equivalent.read, path)


if __name__ == "__main__":
    unittest.main()
