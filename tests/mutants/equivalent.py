"""equivalent.list: mutants that change nothing that a user or a program could notice, each with its reason."""

import dataclasses
import re


@dataclasses.dataclass(frozen=True)
class Entry:
    file: str
    line: str  # the text of the line, since numbers shift
    kind: str
    change: str
    reason: str

    def matches(self, place):
        return (place.file, place.text, place.kind, place.change) == (self.file, self.line, self.kind, self.change)


class BadList(Exception):
    """The list cannot be read."""


def read(path):
    entries = []
    text = re.sub(r"^#.*\n", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    for stanza in filter(None, (each.strip() for each in re.split(r"\n\s*\n", text))):
        first, *rest = stanza.split("\n")
        fields = {}
        for line in rest:
            name, colon, value = line.strip().partition(": ")
            if not colon or name in fields:
                raise BadList(f"{path.name}: {first}: cannot read '{line.strip()}'")
            fields[name] = value
        if set(fields) != {"line", "kind", "change", "reason"}:
            raise BadList(f"{path.name}: {first}: an entry has line, kind, change and reason")
        entries.append(Entry(first.strip(), **fields))
    return entries


def entry_of(place):
    """The text of an entry for a survivor, without its reason."""
    return f"{place.file}\n  line: {place.text}\n  kind: {place.kind}\n  change: {place.change}\n  reason: "
