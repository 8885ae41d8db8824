"""Figures as a table with targets."""


class Table:
    def __init__(self):
        self.rows = []

    def add(self, name, value, unit, reference=None, against="", ratio=None, most=None, least=None):
        """A target is an upper (most) or lower (least) bound: of the ratio if there is one, else of the value."""
        checked = value if ratio is None else ratio
        verdict, target = "", ""
        if most is not None:
            verdict, target = "ok" if checked <= most else "MISS", f"<= {most:g}"
        if least is not None:
            verdict, target = "ok" if checked >= least else "MISS", f">= {least:g}"
        self.rows.append({"name": name, "value": value, "unit": unit, "reference": reference, "against": against,
                          "ratio": ratio, "target": target, "verdict": verdict})

    def skip(self, name, why):
        self.rows.append({"name": name, "value": None, "unit": "", "reference": None, "against": why, "ratio": None,
                          "target": "", "verdict": "skipped"})

    def missed(self):
        return any(row["verdict"] == "MISS" for row in self.rows)

    def text(self):
        def shown(number):
            return "" if number is None else f"{number:.3g}" if abs(number) < 100 else f"{number:.0f}"
        lines = [["", "value", "", "reference", "", "ratio", "target", ""]]
        for row in self.rows:
            lines.append([row["name"], shown(row["value"]), row["unit"], shown(row["reference"]), row["against"],
                          "" if row["ratio"] is None else f"{row['ratio']:.2f}", row["target"], row["verdict"]])
        widths = [max(len(line[i]) for line in lines) for i in range(8)]
        left = (0, 2, 4, 6, 7)
        return "\n".join("  ".join(cell.ljust(width) if i in left else cell.rjust(width)
                                   for i, (cell, width) in enumerate(zip(line, widths))).rstrip() for line in lines)
