#!/usr/bin/env python3
"""one_type_a_name.py ROOT: each name of a type that two sources can see is one type.

Two definitions of `porttape::Name` in one program are undefined behaviour (the one-definition rule) that no compiler tells of:
the linker joins `std::vector<porttape::Name>` of both, and memory for one is used for the other.

It looks at the types that stand at the beginning of a line, in the headers and sources of the rooms, outside of unnamed
namespaces. With --self-test it must find the one that it makes."""

import collections
import pathlib
import re
import sys
import tempfile

FOLDERS = ("libport", "tools", "daemon")
NAMESPACE = re.compile(r"^(?:inline )?namespace ([\w:]*) ?\{", re.MULTILINE)
TYPE = re.compile(r"^(?:struct|class|union|enum(?: class)?) ([\w:]+)(?: final)?(?: : ?[^;{]*)?\s*\{", re.MULTILINE)


def types_of(text):
    """The full names of the types that a source defines."""
    places = [(match.start(), match.group(1)) for match in NAMESPACE.finditer(text)]
    places += [(match.start(), None) for match in re.finditer(r"^\}  // namespace", text, re.MULTILINE)]
    places += [(match.start(), match) for match in TYPE.finditer(text)]
    within = []
    for _, what in sorted(places, key=lambda place: place[0]):
        if what is None:
            if within:
                within.pop()
        elif isinstance(what, str):
            within.append(what)
        elif "" not in within:
            yield "::".join([*within, what.group(1)])


def twice(root):
    """What is defined in several files, and where."""
    found = collections.defaultdict(set)
    for folder in FOLDERS:
        for path in sorted(pathlib.Path(root, folder).rglob("*.[ch]pp")):
            for name in types_of(path.read_text(encoding="utf-8")):
                found[name].add(str(path.relative_to(root)))
    return {name: sorted(files) for name, files in found.items() if len(files) > 1}, len(found)


def self_test():
    """Finds what is there, and nothing else."""
    with tempfile.TemporaryDirectory() as root:
        tools = pathlib.Path(root, "tools")
        tools.mkdir()
        hidden = "namespace porttape {\nnamespace {\nstruct Hidden {\n};\n}  // namespace\nstruct %s {\n};\n}  // namespace porttape\n"
        inner = "namespace porttape::event {\nstruct Twice {\n};\n}  // namespace porttape::event\n"
        (tools / "one.hpp").write_text(hidden % "Twice", encoding="utf-8")
        (tools / "two.cpp").write_text(hidden % "Twice" + inner, encoding="utf-8")
        (tools / "three.hpp").write_text(hidden % "Once", encoding="utf-8")
        found, count = twice(root)
        assert found == {"porttape::Twice": ["tools/one.hpp", "tools/two.cpp"]}, found
        assert count == 3, count


def main():
    """Exit status 1: something is defined twice."""
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    found, count = twice(sys.argv[1])
    if count < 300:
        sys.exit(f"one_type_a_name: only {count} types are found; the search is broken")
    for name, files in found.items():
        print(f"one_type_a_name: FAIL: {name} is defined in {' and '.join(files)}; give one of them another name")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
