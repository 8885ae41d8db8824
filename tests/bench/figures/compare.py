"""Two builds in interleaved pairs: what one is against the other, told from what either varies by itself."""

import math
import statistics
import sys

from .sections import Bench, Failed

HIGHER_IS_BETTER = ("MB/s", "GB/s")
LEAST_CHANGE = 1.02  # less than that is never called better or worse
CHANCE = 0.02


class Figure:
    """One value of both builds, a sample of each a pair."""

    def __init__(self, name, unit):
        self.name, self.unit, self.samples = name, unit, {"base": [], "new": []}

    def complete(self, pairs):
        return all(len(values) == pairs for values in self.samples.values())

    def worsening(self):
        """Each pair's ratio, above 1 where the new build is worse."""
        pairs = zip(self.samples["new"], self.samples["base"])
        if self.unit in HIGHER_IS_BETTER:
            return [base / max(new, 1e-12) for new, base in pairs]
        return [new / max(base, 1e-12) for new, base in pairs]

    def verdict(self):
        """A change counts when it is outside what the middle half of the base's own samples spans, and so many pairs agree
        about its direction as chance hardly makes (of 9 pairs 8)."""
        new, base, ratios = statistics.median(self.samples["new"]), self.samples["base"], self.worsening()
        if lower_quartile(base) <= new <= upper_quartile(base):
            return "within the spread"
        middle = statistics.median(ratios)
        if middle > LEAST_CHANGE and agree(sum(ratio > 1 for ratio in ratios), len(ratios)):
            return "WORSE"
        if middle < 1 / LEAST_CHANGE and agree(sum(ratio < 1 for ratio in ratios), len(ratios)):
            return "better"
        return "within the spread"

    def row(self):
        base, new = self.samples["base"], self.samples["new"]
        ratios = [a / b if b else 1.0 for a, b in zip(new, base)]
        return {"name": self.name, "unit": self.unit, "base": statistics.median(base), "new": statistics.median(new),
                "ratio": statistics.median(ratios), "base_spread": [min(base), max(base)], "new_spread": [min(new), max(new)],
                "pairs": len(base), "verdict": self.verdict()}


def agree(count, pairs):
    """The sign test: whether coins would show so many heads, or more, in at most CHANCE of all tries."""
    return sum(math.comb(pairs, heads) for heads in range(count, pairs + 1)) / 2**pairs <= CHANCE


def lower_quartile(values):
    return statistics.quantiles(values, n=4, method="inclusive")[0] if len(values) > 1 else values[0]


def upper_quartile(values):
    return statistics.quantiles(values, n=4, method="inclusive")[2] if len(values) > 1 else values[0]


def named(section, rows):
    """The rows that say something of the build (not of a bare line, not that it was skipped), by names of their own: an
    indented one belongs to the one above."""
    above = ""
    for row in rows:
        if not row["name"].startswith(" "):
            above = row["name"]
        name = above if above == row["name"] else above + "," + row["name"].replace("  ", " ")
        if row["value"] is not None and "bare" not in name:
            yield f"{section}: {name}", row


def compare(builds, sections, pairs, folder, progress=sys.stderr):
    """`builds`: the programs of "base" and of "new". Gives the figures in order, and what failed."""
    figures, failures = {}, []
    for number in range(pairs):
        for section in list(sections):
            # The one that goes first changes from pair to pair.
            for build in ("base", "new") if number % 2 == 0 else ("new", "base"):
                bench = Bench("pair", builds[build], folder)
                try:
                    getattr(bench, section)()
                except Failed as failure:
                    failures.append(f"{section}, {build}: {failure}")
                    sections = [each for each in sections if each != section]
                    break
                for name, row in named(section, bench.table.rows):
                    figures.setdefault(name, Figure(name, row["unit"])).samples[build].append(row["value"])
        print(f"pair {number + 1} of {pairs}", file=progress, flush=True)
    return [figure for figure in figures.values() if figure.complete(pairs)], failures


def text(rows):
    def shown(number):
        return f"{number:.3g}" if abs(number) < 100 else f"{number:.0f}"

    lines = [["", "base", "new", "", "ratio", "base's spread", "new's spread", ""]]
    for row in rows:
        spreads = [shown(row[key][0]) + " - " + shown(row[key][1]) for key in ("base_spread", "new_spread")]
        lines.append([row["name"], shown(row["base"]), shown(row["new"]), row["unit"], f"{row['ratio']:.2f}", *spreads,
                      row["verdict"]])
    widths = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]
    return "\n".join("  ".join(cell.ljust(width) if i in (0, 3, 5, 6, 7) else cell.rjust(width)
                               for i, (cell, width) in enumerate(zip(line, widths))).rstrip() for line in lines)
