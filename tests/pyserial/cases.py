#!/usr/bin/python3
"""cases.py TESTS PORT PARITY [CASE…]: pyserial's test-suite in the folder TESTS on PORT, in one process, without those cases.

Where a case asks for no parity (N, E or O) itself, its port is opened with PARITY.

One JSON line when a case begins ({"begin": CASE}), and one when it ends ({"case", "result", "why"}; result is pass, fail
or skip). Then it waits for a line on its standard input. The caller ends a case that hangs, and goes on without it.
"""

import importlib
import json
import os
import sys
import unittest
import warnings


def tell(**line):
    os.write(1, (json.dumps(line) + "\n").encode())


def cases_of(suite):
    for test in suite:
        if isinstance(test, unittest.TestSuite):
            yield from cases_of(test)
        else:
            yield test


def last_line(text):
    return text.strip().splitlines()[-1] if text.strip() else ""


class Results(unittest.TestResult):
    def startTest(self, test):
        super().startTest(test)
        self.came = ("pass", "")
        tell(begin=test.id())

    def addFailure(self, test, err):
        super().addFailure(test, err)
        self.came = ("fail", last_line(self.failures[-1][1]))

    def addError(self, test, err):
        super().addError(test, err)
        why = last_line(self.errors[-1][1])
        if self.came[0] != "fail":  # that of the case itself before that of its tearDown
            self.came = ("fail", why)

    def addSkip(self, test, reason):
        super().addSkip(test, reason)
        self.came = ("skip", reason)

    def stopTest(self, test):
        super().stopTest(test)
        tell(case=test.id(), result=self.came[0], why=self.came[1])


def open_with(parity):
    import serial  # that of the tests

    made = serial.Serial.__init__
    serial.Serial.__init__ = lambda self, *words, **named: made(self, *words, **{"parity": parity, **named})


def main(tests, port, parity, skipped):
    sys.path[:0] = [tests, os.path.dirname(os.path.abspath(tests))]  # the pyserial that these tests belong to
    os.chdir(tests)  # test_url looks for its handlers there
    warnings.simplefilter("ignore")
    sys.stdout = sys.stderr  # the cases' own words
    if parity != "N":
        open_with(parity)
    results = Results()
    for name in sorted(name[:-3] for name in os.listdir(".") if name.startswith("test") and name.endswith(".py")):
        module = importlib.import_module(name)
        module.PORT = port
        for test in cases_of(unittest.defaultTestLoader.loadTestsFromModule(module)):
            if test.id() not in skipped:
                test.run(results)
                sys.stdin.readline()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3], set(sys.argv[4:]))
