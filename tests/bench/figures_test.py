#!/usr/bin/env python3
"""What the comparison of two builds calls better, worse, and neither."""

import pathlib
import sys
import unittest

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from figures import compare  # noqa: E402


def figure(base, new, unit="us"):
    made = compare.Figure("figure", unit)
    made.samples["base"], made.samples["new"] = base, new
    return made


STEADY = [100, 101, 99, 100, 102, 98, 100, 101, 99]


class Verdicts(unittest.TestCase):
    def test_equal_builds_are_within_the_spread(self):
        self.assertEqual(figure(STEADY, STEADY[::-1]).verdict(), "within the spread")

    def test_a_clear_slowdown_is_worse_and_its_reverse_better(self):
        slower = [value * 1.2 for value in STEADY]
        self.assertEqual(figure(STEADY, slower).verdict(), "WORSE")
        self.assertEqual(figure(slower, STEADY).verdict(), "better")

    def test_more_bytes_a_second_are_better(self):
        more = [value * 1.2 for value in STEADY]
        self.assertEqual(figure(STEADY, more, "MB/s").verdict(), "better")
        self.assertEqual(figure(more, STEADY, "MB/s").verdict(), "WORSE")

    def test_one_outlier_changes_nothing(self):
        self.assertEqual(figure(STEADY, STEADY[:-1] + [10000]).verdict(), "within the spread")

    def test_a_noisy_base_hides_a_small_change(self):
        noisy = [50, 150, 60, 140, 100, 70, 130, 90, 110]
        self.assertEqual(figure(noisy, [value * 1.1 for value in noisy]).verdict(), "within the spread")

    def test_three_pairs_prove_nothing(self):
        self.assertEqual(figure([100, 101, 99], [150, 151, 152]).verdict(), "within the spread")

    def test_nothing_against_nothing_is_no_change(self):
        self.assertEqual(figure([0] * 9, [0] * 9).row()["ratio"], 1)
        self.assertEqual(figure([0] * 9, [0] * 9).verdict(), "within the spread")

    def test_rows_get_names_of_their_own(self):
        rows = [{"name": "a", "value": 1}, {"name": "  memory", "value": 2}, {"name": "b", "value": 3},
                {"name": "  memory", "value": 4}, {"name": "bare pty", "value": 5}, {"name": "c", "value": None}]
        self.assertEqual([name for name, _ in compare.named("s", rows)], ["s: a", "s: a, memory", "s: b", "s: b, memory"])


if __name__ == "__main__":
    unittest.main()
