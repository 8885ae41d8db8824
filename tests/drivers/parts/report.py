"""What is printed: each result as it comes, and the table of all."""

WAYS = ("pty", "direct", "recorded", "replayed")


class Table:
    def __init__(self):
        self._rows = {}  # name: {way: [wrong, …] a run}
        self._skipped = {}

    def add(self, case, result):
        self._rows.setdefault(case.name, {}).setdefault(result.way, []).append(result.wrong)
        print(f"{case.name:<12} {result.way:<9} {'ok' if not result.wrong else 'NOT OK':<7} {result.seconds:6.1f} s  "
              + "; ".join(result.notes), flush=True)
        for reason in result.wrong:
            print(f"{'':12} {reason}", flush=True)

    def skip(self, case, reason):
        self._skipped[case.name] = reason

    def exit_status(self):
        if any(any(runs) for ways in self._rows.values() for runs in ways.values()):
            return 1
        return 77 if self._skipped or not self._rows else 0

    def markdown(self, cases, version_of):
        """A table of what works with porttape, of the cases that were run."""
        lines = ["| driver | package | " + " | ".join(WAYS) + " | what it does |", "|---" * (len(WAYS) + 3) + "|"]
        for case in cases:
            ways = self._rows.get(case.name)
            if ways:
                packages = ", ".join(f"{package} {version_of(package)}" for package in case.packages[:1])
                cells = " | ".join(cell(ways.get(way, [])) for way in WAYS)
                lines.append(f"| `{case.name}` | {packages} | {cells} | {case.shows} |")
        return "\n".join(lines) + "\n"

    def print_summary(self, seconds):
        print(f"\n{'driver':<12}" + "".join(f" {way:<10}" for way in WAYS))
        for name, ways in self._rows.items():
            print(f"{name:<12}" + "".join(f" {cell(ways.get(way, [])):<10}" for way in WAYS).rstrip())
        for name, reason in self._skipped.items():
            print(f"{name:<12} skipped: {reason}")
        print(f"{seconds:.0f} s")


def cell(runs):
    right = sum(not wrong for wrong in runs)
    if not runs:
        return "-"
    if len(runs) == 1:
        return "ok" if right else "NOT OK"
    return f"{right}/{len(runs)}" + ("" if right == len(runs) else " NOT OK")
