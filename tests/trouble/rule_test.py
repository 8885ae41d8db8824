#!/usr/bin/env python3
"""What `run` makes of cases that are late once, late twice, late and wrong, and unstable by the dozen. Nothing is run."""

import contextlib
import importlib.machinery
import importlib.util
import io
import os
import sys
import types
import unittest

HERE = os.path.dirname(os.path.realpath(__file__))
sys.dont_write_bytecode = True
LOADER = importlib.machinery.SourceFileLoader("run", os.path.join(HERE, "run"))
run = importlib.util.module_from_spec(importlib.util.spec_from_loader("run", LOADER))
LOADER.exec_module(run)


def world(findings=(), late=()):
    made = types.SimpleNamespace(findings=list(findings), late=list(late), notes=[], sites=[], injected=1)
    made.only_late = run.scenarios.World.only_late.fget(made)
    return made


class Rule(unittest.TestCase):
    def play(self, worlds, most=run.MOST_UNSTABLE):
        """The cases of `record`, by what each gives when it runs first and then; the suite behind them."""
        config = types.SimpleNamespace(names={"porttaped": types.SimpleNamespace(places=lambda sites: {})})
        suite = run.Suite(config, types.SimpleNamespace(jobs=2))
        left = {trouble: list(each) for trouble, each in worlds.items()}
        self.order = []

        def play(_name, trouble=None, _addresses=()):
            self.order.append(trouble)
            return left[trouble].pop(0)
        suite.play = play
        with contextlib.redirect_stdout(io.StringIO()):
            suite.run_cases([("record", trouble, ()) for trouble in worlds])
            suite.run_late_cases_again(most)
        return suite

    def test_late_once_is_unstable(self):
        suite = self.play({"a": [world(late=["60 s"]), world()], "b": [world()]})
        self.assertEqual(suite.findings, [])
        self.assertEqual(suite.unstable, [("record", "a", "record a: 60 s")])
        self.assertEqual(self.order[2:], ["a"])

    def test_late_once_is_a_finding_where_none_may_be(self):
        self.assertEqual(len(self.play({"a": [world(late=["60 s"]), world()]}, most=0).findings), 1)

    def test_late_twice_is_a_finding(self):
        suite = self.play({"a": [world(late=["60 s"]), world(late=["61 s"])]})
        self.assertEqual(suite.findings, [("record", "a", "late again; 61 s")])
        self.assertEqual(suite.unstable, [])

    def test_late_and_then_wrong_is_a_finding(self):
        self.assertEqual(self.play({"a": [world(late=["60 s"]), world(["a byte"])]}).findings, [("record", "a", "a byte")])

    def test_what_is_wrong_and_late_does_not_run_again(self):
        suite = self.play({"a": [world(["a byte"], ["60 s"])]})
        self.assertEqual(suite.findings, [("record", "a", "a byte"), ("record", "a", "60 s")])
        self.assertEqual(self.order, ["a"])

    def test_four_unstable_ones_are_findings(self):
        once = {name: [world(late=["60 s"]), world()] for name in "abcd"}
        suite = self.play(once)
        self.assertEqual((len(suite.findings), len(suite.unstable)), (4, 4))
        once = {name: [world(late=["60 s"]), world()] for name in "abc"}
        self.assertEqual(self.play(once).findings, [])


unittest.main()
