"""The programs to measure, and the machine they run on."""

import os
import pathlib
import platform
import shutil
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[3]


def find_programs(arguments):
    if arguments.build:
        builds = [pathlib.Path(arguments.build)]
    else:
        builds = [path.parents[2] for path in ROOT.glob("build/*/tests/bench/linebench")]
        builds.sort(key=lambda path: (path / "tests/bench/linebench").stat().st_mtime, reverse=True)
    if not builds or not (builds[0] / "tests/bench/linebench").exists():
        sys.exit("run: no linebench; build it (cmake --build --preset release --target linebench) or give --build")
    programs = {"linebench": builds[0] / "tests/bench/linebench"}
    for name, given, default in (("porttaped", arguments.porttaped, builds[0] / "daemon/porttaped"),
                                 ("porttape", arguments.porttape, builds[0] / "tools/porttape")):
        path = pathlib.Path(given) if given else default
        if given and not path.exists():
            sys.exit(f"run: --{name} {given}: no such file")
        programs[name] = path.resolve() if path.exists() else None
    programs["socat"] = shutil.which("socat")
    return programs


def busy_percent(seconds):
    def ticks():
        with open("/proc/stat", encoding="ascii") as stat:
            values = [int(value) for value in stat.readline().split()[1:9]]
        return sum(values), values[3] + values[4]
    total, idle = ticks()
    time.sleep(seconds)
    total_after, idle_after = ticks()
    return 100 * (1 - (idle_after - idle) / max(1, total_after - total))


def machine():
    return {"cores": os.cpu_count(), "kernel": platform.release(), "load_average": os.getloadavg()[0],
            "busy_percent_before": round(busy_percent(1), 1)}


def other_build(folder):
    """The programs of a build tree to compare with; linebench stays this tree's."""
    programs = {"porttaped": pathlib.Path(folder) / "daemon/porttaped", "porttape": pathlib.Path(folder) / "tools/porttape"}
    for path in programs.values():
        if not path.exists():
            sys.exit(f"run: --against {folder}: no {path.relative_to(folder)} there; build it first")
    return {name: path.resolve() for name, path in programs.items()}
