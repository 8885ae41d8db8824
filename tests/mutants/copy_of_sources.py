"""The copy of the sources that holds the mutants, and its build."""

import os
import pathlib
import re
import subprocess

ROOT = pathlib.Path(__file__).resolve().parents[2]
WORK = ROOT / "build" / "mutants"
SOURCE = WORK / "source"  # a copy of the project, in which the drawn sources are rewritten
BUILD = WORK / "build"
TREE = WORK / "tree"  # configured without unity and never built: the compile command of each source

# The programs are built as ./check builds them, but for -O1, which compiles faster. Warnings about mutants help nobody.
OPTIONS = ["-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", "-DCMAKE_CXX_FLAGS_RELEASE=-O1 -DNDEBUG",
           "-DCMAKE_CXX_FLAGS=-w -Wno-narrowing", "-DBUILD_TESTING=ON",
           f"-DPORTTAPE_SHARED_DIR={ROOT.parent / 'shared'}"]
SWITCH = """
# Added by tests/mutants/run.
target_sources(porttape PRIVATE ${PROJECT_SOURCE_DIR}/tests/mutants/switch.cpp)
"""


class BuildFailed(Exception):
    """A step of the build failed; its text is the output."""


def run(*command, **options):
    done = subprocess.run(list(map(str, command)), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True, errors="replace", check=False, **options)
    return done.returncode, done.stdout


def write_if_changed(path, text):
    """Leaves the file's time alone where it already holds `text`, so that nothing is built anew."""
    data = text.encode() if isinstance(text, str) else text
    if not path.is_file() or path.read_bytes() != data:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def files_of_project():
    listed = subprocess.run(["git", "-C", ROOT, "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
                            stdout=subprocess.PIPE, check=True).stdout
    return [name for name in listed.decode().split("\0") if name and (ROOT / name).is_file()]


def update(changed):
    """Makes the copy equal to the project, but for the sources of `changed`: {name: text}."""
    names = files_of_project()
    for name in names:
        target = SOURCE / name
        if name == "libport/CMakeLists.txt":
            write_if_changed(target, (ROOT / name).read_text(encoding="utf-8") + SWITCH)
        elif name in changed:
            write_if_changed(target, changed[name])
        else:
            write_if_changed(target, (ROOT / name).read_bytes())
        mode = (ROOT / name).stat().st_mode & 0o777
        if target.stat().st_mode & 0o777 != mode:
            target.chmod(mode)
    known = set(names)
    for path in [path for path in SOURCE.rglob("*") if path.is_file() and str(path.relative_to(SOURCE)) not in known]:
        path.unlink()


def configure(folder, *options):
    status, output = run("cmake", "-S", SOURCE, "-B", folder, *OPTIONS, *options)
    if status != 0:
        raise BuildFailed(output)


def environment():
    """For the compiler. A cache of its results sees the same paths wherever the project lies."""
    return {**os.environ, "CCACHE_BASEDIR": str(WORK), "CCACHE_NOHASHDIR": "1", "LC_ALL": "C"}


def build(targets, jobs):
    """Status and output; it goes on after an error, so that all errors are told at once."""
    return run("cmake", "--build", BUILD, "-j", jobs, "--target", *targets, "--", "-k", "0", env=environment())


def rooms_below():
    """{room: the rooms that it may include}, of libport/rooms.cmake."""
    text = (ROOT / "libport" / "rooms.cmake").read_text(encoding="utf-8")
    below = {room: set(rest.split()) for room, rest in re.findall(r"^set\(below_(\w+)([^)]*)\)", text, re.MULTILINE)}
    for room, rest in below.items():
        if "${below_tools}" in rest:
            below[room] = (rest - {"${below_tools}"}) | below["tools"]
    for _ in below:  # a room below one that is below is below, too
        for room in below:
            below[room] = below[room].union(*(below.get(each, set()) for each in below[room]))
    return below


def folder_of(room):
    return room if room in ("tools", "daemon") else f"libport/{room}"


def sources_of(room):
    return sorted(str(path.relative_to(ROOT)) for path in (ROOT / folder_of(room)).glob("*.cpp"))


def test_programs(rooms):
    """The unit test programs of these rooms, as cmake's targets: [(room, target)]."""
    found = []
    for room in rooms:
        lists = ROOT / "tests" / room / "CMakeLists.txt"
        if lists.is_file():
            found += [(room, name) for name in re.findall(r"^porttape_test\((\w+)", lists.read_text(encoding="utf-8"),
                                                          re.MULTILINE)]
    return found
