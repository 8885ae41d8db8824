"""tests/mutants/run, once its packages are there. README.md has the whole in words."""

import argparse
import collections
import concurrent.futures
import contextlib
import fcntl
import hashlib
import json
import multiprocessing
import os
import pathlib
import pickle
import random
import re
import shlex
import subprocess
import sys
import time

import copy_of_sources as project
import equivalent
import places
import trial

HERE = pathlib.Path(__file__).resolve().parent
CORE = ["session", "taped", "tape", "replay", "rules", "tty", "net", "port", "loop", "faults"]
OTHERS = ["formats", "supervise", "tools", "daemon"]
# The number of mutants of 100 that must be found in each room, and in all rooms of CORE together.
LEAST_OF_CORE_ROOM, LEAST_OF_CORE, LEAST_OF_OTHER = 85, 92, 80
MOST_EQUIVALENT = 3  # of 100
HEADER = '#include "tests/mutants/switch.hpp"\n#line 1 "{}"\n'
ERROR = re.compile(r"^(/[^:\n]+):(\d+):\d+: (?:fatal )?error:", re.MULTILINE)

DESCRIPTION = f"""Changes one place of the sources at a time, and finds out whether a test notices.

All drawn mutants are compiled into one build, in build/mutants; the environment variable PORTTAPE_MUTANT=N selects mutant N,
and without it the program is as it was. For each mutant the unit tests of its room run that reach the place, those of the
rooms above it if they also take less than {trial.QUICK:g} s, and then the simulation; for the rooms of whole programs
({', '.join(sorted(trial.SCRIPTED))}) also the scripts of tests/e2e that take less than {trial.SCRIPT_LIMIT:g} s. The first that fails
ends it."""
EPILOG = """kinds: """ + "; ".join(f"{name} ({text})" for name, text in places.KINDS.items()) + f""".

The draw depends on the seed, the rooms, the count and the sources. It takes as many from each room, and in a room as
many of each kind, as far as there are.

Exit status: 0: every room reached its share: {LEAST_OF_CORE_ROOM} of 100 ({', '.join(CORE)}; {LEAST_OF_CORE} of 100 in all of
these), {LEAST_OF_OTHER} of 100 (the others), and at most {MOST_EQUIVALENT} of 100 are in equivalent.list. With --only:
all were found. 1: not so, or a step failed. 2: wrong usage."""


def arguments():
    parser = argparse.ArgumentParser(prog="tests/mutants/run", description=DESCRIPTION, epilog=EPILOG)
    parser.add_argument("--room", action="append", metavar="ROOM[,ROOM…]",
                        help="draw from these rooms; default: " + ",".join(CORE))
    parser.add_argument("--count", type=int, metavar="N", help="draw N mutants (500; with --changed-since: all)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the draw (1)")
    parser.add_argument("--kind", action="append", choices=places.KINDS, help="only mutants of this kind")
    parser.add_argument("--changed-since", metavar="REV", help="only mutants on lines that differ from this commit")
    parser.add_argument("--only", action="append", metavar="WHICH", help="try these again: FILE:LINE, FILE:LINE:KIND, "
                        "FILE:LINE:COLUMN:KIND, a number of the last draw, or a file of survivors. The last build is used "
                        "where it holds them and the sources are as they were")
    parser.add_argument("--list", action="store_true", help="print the drawn mutants, and build nothing")
    parser.add_argument("--show", type=int, metavar="N", help="print mutant N of the last draw: the change as source text, "
                        "how to run it by hand, its entry for equivalent.list")
    parser.add_argument("--seeds", type=int, default=4000, metavar="N", help="seeds of the simulation (4000); 0: none")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), metavar="N", help="tests that run at once (%(default)s)")
    parser.add_argument("--survivors", type=pathlib.Path, default=project.WORK / "survivors.txt", metavar="FILE",
                        help="where the list of survivors goes (build/mutants/survivors.txt)")
    parser.add_argument("--check-list", action="store_true",
                        help="check that each entry of equivalent.list still names a mutant, and do nothing else")
    parser.add_argument("--verbose", action="store_true", help="print what found each mutant")
    given = parser.parse_args()
    known = project.rooms_below()
    given.rooms = [room for each in given.room or [",".join(CORE)] for room in each.split(",")]
    for room in given.rooms:
        if room not in known:
            parser.error(f"there is no room '{room}': {', '.join(known)}")
    if (given.count is not None and given.count < 1) or given.jobs < 1 or given.seeds < 0:
        parser.error("--count and --jobs are at least 1, --seeds at least 0")
    return given, parser


def say(text):
    print(f"== {text}", flush=True)


def progress(text):
    if sys.stdout.isatty():
        print(f"\r\033[K{text}", end="", flush=True)


# The places.

def compile_commands():
    """{source: clang's arguments}, of a configured folder that is never built."""
    lists = [project.ROOT / name for name in project.files_of_project() if name.endswith(("CMakeLists.txt", ".cmake"))]
    state, stamp = state_of(lists), project.TREE / "lists"
    if not stamp.is_file() or stamp.read_text(encoding="utf-8") != state:
        status, output = project.run("cmake", "-S", project.ROOT, "-B", project.TREE, *project.OPTIONS,
                                     "-DCMAKE_UNITY_BUILD=OFF")
        if status != 0:
            raise project.BuildFailed(output)
        stamp.write_text(state, encoding="utf-8")
    commands = {}
    for entry in json.loads((project.TREE / "compile_commands.json").read_text(encoding="utf-8")):
        words = shlex.split(entry["command"])
        first = next(n for n, word in enumerate(words) if word.startswith("-"))
        words = words[first:]
        for option in ("-o", "-c"):
            at = words.index(option)
            del words[at:at + 2]
        commands[entry["file"]] = words
    return commands


def state_of(files):
    """A digest of these files."""
    state = hashlib.sha256()
    for name in files:
        with contextlib.suppress(OSError), open(name, "rb") as file:
            state.update(file.read())
    return state.hexdigest()


def places_of(task):
    """The places of a source, which are kept as long as nothing changes that it includes of the project."""
    name, words = task
    path = str(project.ROOT / name)
    base = hashlib.sha256("\0".join([name, *words, state_of([places.__file__])]).encode()).hexdigest()
    kept = project.WORK / "places" / (name.replace("/", "_") + ".pickle")
    with contextlib.suppress(OSError, EOFError, ValueError, pickle.UnpicklingError, AttributeError):
        key, files, state, found = pickle.loads(kept.read_bytes())
        if key == base and state == state_of(files):
            return found
    found, included = places.find(name, path, words)
    files = [path, *(each for each in included if each.startswith(str(project.ROOT)))]
    kept.parent.mkdir(parents=True, exist_ok=True)
    kept.write_bytes(pickle.dumps((base, files, state_of(files), found)))
    return found


def all_places(rooms, jobs, names=None):
    """{room: places} of all sources of these rooms, or of those of `names`."""
    commands = compile_commands()
    tasks = [(room, name, commands[str(project.ROOT / name)]) for room in rooms for name in project.sources_of(room)
             if (names is None or name in names) and str(project.ROOT / name) in commands]
    found = {room: [] for room in rooms}
    with multiprocessing.Pool(jobs) as pool:
        results = pool.imap(places_of, [task[1:] for task in tasks])
        for index, ((room, name, _), some) in enumerate(zip(tasks, results)):
            found[room] += some
            progress(f"{index + 1} of {len(tasks)} sources: {name}")
    progress("")
    return found


def changed_lines(revision):
    """{file: numbers of lines} that differ from a commit."""
    done = subprocess.run(["git", "-C", project.ROOT, "diff", "-U0", "--no-color", "--no-ext-diff", revision, "--", "*.cpp"],
                          stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        sys.exit(2)
    lines, name = {}, None
    for line in done.stdout.splitlines():
        if line.startswith("+++ "):
            name = line[6:]
        elif line.startswith("@@"):
            first, count = re.match(r"@@ \S+ \+(\d+)(?:,(\d+))? @@", line).groups()
            lines.setdefault(name, set()).update(range(int(first), int(first) + int(count or 1)))
    return lines


def draw(found, count, seed):
    """`count` places: as many of each room, and in a room of each kind, as there are."""
    queues = {}
    for room, some in found.items():
        kinds = {}
        for place in some:
            kinds.setdefault(place.kind, []).append(place)
        for kind, each in sorted(kinds.items()):
            each.sort(key=lambda place: place.key)
            random.Random(f"{seed} {room} {kind}").shuffle(each)
        order = []
        while any(kinds.values()):
            for kind in places.KINDS:
                if kinds.get(kind):
                    order.append(kinds[kind].pop())
        queues[room] = collections.deque(order)
    drawn = []
    while len(drawn) < count and any(queues.values()):
        for room, some in queues.items():
            if some and len(drawn) < count:
                drawn.append((room, some.popleft()))
    return drawn


def selected(which, found, plan):
    """The places that --only names."""
    wanted = []
    for each in which:
        if os.path.isfile(each):
            wanted += [line.split("  [")[0] for line in pathlib.Path(each).read_text(encoding="utf-8").splitlines()
                       if line and not line.startswith("#")]
        else:
            wanted.append(each)
    chosen = []
    for each in wanted:
        if each.isdigit():
            some = [(room, place) for number, room, place in plan if number == int(each)]
        else:
            match = re.match(r"([^:]+):(\d+)(?::(\d+))?(?::\s*([a-z-]+))?(?:: (.*))?$", each)
            if not match:
                raise ValueError(f"--only: cannot read '{each}'")
            file, line, column, kind, change = match.groups()
            some = [(room, place) for room, all_of_it in found.items() for place in all_of_it
                    if place.file.endswith(file) and kind in (None, place.kind) and change in (None, place.change)]
            here = [(room, place) for room, place in some
                    if place.line == int(line) and column in (None, str(place.column))]
            # The line may have moved since the list was written.
            some = here or ([] if change is None else some if len(some) == 1 else [])
        if not some:
            print(f"no mutant now: {each}", file=sys.stderr)
        chosen += [each for each in some if each not in chosen]
    return chosen


def names_of(which, plan):
    """The sources that --only names, or None for any."""
    names = set()
    for each in which:
        if os.path.isfile(each):
            names |= {line.split(":")[0] for line in pathlib.Path(each).read_text(encoding="utf-8").splitlines()}
        elif each.isdigit():
            names |= {place.file for number, _, place in plan if number == int(each)}
        else:
            names.add(each.split(":")[0])
    every = {room: project.sources_of(room) for room in project.rooms_below()}
    rooms = {room: [name for name in some if any(name.endswith(each) for each in names if each)]
             for room, some in every.items()}
    return {room: some for room, some in rooms.items() if some}


# The build.

class Plan:
    """The mutants of the build: [(number, room, place)], and the state of the sources that they were made of."""

    path = project.WORK / "plan.pickle"

    def __init__(self, mutants=()):
        self.mutants = list(mutants)
        self.states = {name: state_of([project.ROOT / name]) for name in {place.file for _, _, place in self.mutants}}

    @classmethod
    def last(cls):
        try:
            return pickle.loads(cls.path.read_bytes())
        except (OSError, EOFError, ValueError, AttributeError, pickle.UnpicklingError):
            return cls()

    def save(self):
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.write_bytes(pickle.dumps(self))

    def holds(self, chosen):
        """The chosen mutants with their numbers here, or None if one is missing or a source has changed."""
        if any(state_of([project.ROOT / name]) != state for name, state in self.states.items()):
            return None
        numbers = {place: number for number, _, place in self.mutants}
        if any(place not in numbers for _, place in chosen):
            return None
        return [(numbers[place], room, place) for room, place in chosen]

    def sources(self):
        """{name: text} of the sources with their mutants."""
        by_file = {}
        for number, _, place in self.mutants:
            by_file.setdefault(place.file, []).append((number, place))
        return {name: HEADER.format(project.SOURCE / name).encode()
                + places.rewritten((project.ROOT / name).read_bytes(), some) for name, some in by_file.items()}

    def culprits(self, output):
        """The numbers of the mutants that a compiler's errors point to."""
        bad = set()
        for path, line in set(ERROR.findall(output)):
            if not path.startswith(str(project.SOURCE) + "/"):
                continue
            name, line = path[len(str(project.SOURCE)) + 1:], int(line)
            here = [(number, place) for number, _, place in self.mutants if place.file == name]
            text = (project.ROOT / name).read_bytes() if here else b""
            on_line = {number for number, place in here if place.line == line}
            around = {number for number, place in here
                      if place.line <= line <= place.line + text[place.start:place.end].count(b"\n")}
            bad |= on_line or around
        if not bad:  # errors elsewhere that a mutant causes: all of the sources that are named
            bad = {number for number, _, place in self.mutants if str(project.SOURCE / place.file) + ":" in output}
        return bad


def build(plan, jobs):
    """Builds what the tests need. Returns the plan without the mutants that do not compile, and these."""
    targets = [name for _, name in project.test_programs(project.rooms_below())] + ["simulate"]
    if any(room in trial.SCRIPTED for _, room, _ in plan.mutants):
        targets = ["all"]
    dropped = []
    while True:
        project.update(plan.sources())
        if not (project.BUILD / "build.ninja").is_file():
            project.configure(project.BUILD)
        status, output = project.build(targets, jobs)
        if status == 0:
            return plan, dropped
        (project.WORK / "build.log").write_text(output, encoding="utf-8")
        bad = plan.culprits(output)
        if not bad:
            raise project.BuildFailed(output[-4000:])
        dropped += [each for each in plan.mutants if each[0] in bad]
        say(f"{len(bad)} mutants do not compile and are left out")
        plan = Plan([each for each in plan.mutants if each[0] not in bad])


# The run.

def measured(workers, rooms, scripts, size, seeds, pool):
    """The tests of these rooms that pass, with what they reach, and the simulation; `scripts`: those of tests/e2e too."""
    measures = trial.Measures(size)
    tests = trial.listed_tests(rooms, scripts)
    program = str(project.BUILD / "tests" / "simulation" / "simulate")
    simulation = (program, seeds, 0, frozenset())
    began = pool.submit(workers.use, measures.simulation, program, seeds) if seeds else None
    todo = {pool.submit(workers.use, measures.measure, test): test for test in tests}
    kept = []
    for done, future in enumerate(concurrent.futures.as_completed(todo), 1):
        test, told = todo[future], future.result()
        if told is not None:
            test.seconds, test.reaches = told[0], frozenset(told[1])
            kept.append(test)
        progress(f"{done} of {len(tests)} tests without a mutant")
    if began is not None:
        seconds, reached = began.result()
        simulation = (program, seeds, seconds, frozenset(reached))
    progress("")
    measures.save({program, *(test.program for test in tests)})
    kept.sort(key=lambda test: (test.program, test.name))
    return kept, simulation


def share(found, tried):
    return 100 * found / tried if tried else 100


class Report:
    def __init__(self, rooms, results, entries):
        self.rooms, self.results = rooms, results
        self.equivalent = {number for number, _, place, verdict in results
                           if not verdict.found and any(entry.matches(place) for entry in entries)}

    def counts(self, rooms):
        """Tried, found, equivalent."""
        some = [each for each in self.results if each[1] in rooms]
        return len(some), sum(each[3].found for each in some), sum(each[0] in self.equivalent for each in some)

    def share(self, rooms):
        tried, found, same = self.counts(rooms)
        return share(found, tried - same)

    def survivors(self):
        return [each for each in self.results if not each[3].found and each[0] not in self.equivalent]

    def kinds(self):
        """What was found of each kind, in a line."""
        tried = collections.Counter(each[2].kind for each in self.results if each[0] not in self.equivalent)
        found = collections.Counter(each[2].kind for each in self.results if each[3].found)
        return ", ".join(f"{kind} {found[kind]} of {tried[kind]}" for kind in places.KINDS if tried[kind])

    def table(self):
        lines = [f"{'room':<12}{'tried':>7}{'found':>7}{'equivalent':>12}{'share':>8}"]
        rows = [(room, [room]) for room in self.rooms] + ([("all", self.rooms)] if len(self.rooms) > 1 else [])
        for name, rooms in rows:
            tried, found, same = self.counts(rooms)
            lines.append(f"{name:<12}{tried:>7}{found:>7}{same:>12}{self.share(rooms):>7.1f}%")
        return lines

    def faults(self):
        """Why the run is red."""
        faults = []
        for room in self.rooms:
            least = LEAST_OF_CORE_ROOM if room in CORE else LEAST_OF_OTHER
            if self.share([room]) < least:
                faults.append(f"{room}: {self.share([room]):.1f} of 100 were found, {least} must be")
        if set(self.rooms) >= set(CORE) and self.share(CORE) < LEAST_OF_CORE:
            faults.append(f"{self.share(CORE):.1f} of 100 were found in all, {LEAST_OF_CORE} must be")
        tried, _, same = self.counts(self.rooms)
        if same > tried * MOST_EQUIVALENT / 100:
            faults.append(f"{same} of {tried} mutants are in equivalent.list, {MOST_EQUIVALENT} of 100 may be")
        return faults

    def write(self, survivors, heading):
        survivors.parent.mkdir(parents=True, exist_ok=True)
        survivors.write_text(f"# {heading}\n" + "".join(f"{place}  [{number}: {verdict.by}]\n" for number, _, place, verdict
                                                        in self.survivors()), encoding="utf-8")
        told = [{"number": number, "room": room, "file": place.file, "line": place.line, "column": place.column,
                 "kind": place.kind, "change": place.change, "found": verdict.found, "by": verdict.by, "how": verdict.how,
                 "runs": verdict.runs, "seconds": round(verdict.seconds, 3), "equivalent": number in self.equivalent}
                for number, room, place, verdict in self.results]
        (project.WORK / "results.json").write_text(json.dumps(told, indent=1), encoding="utf-8")


def show(number):
    plan = Plan.last()
    for each, room, place in plan.mutants:
        if each == number:
            data = (project.ROOT / place.file).read_bytes()
            print(place, "", sep="\n")
            changed = places.rewritten(data, [(number, place)]).replace(f"::porttape_mutants::on({number})".encode(), b"MUTANT")
            subprocess.run(["diff", "-u", "--label", place.file, "--label", f"mutant {number}", project.ROOT / place.file, "-"],
                           input=changed, check=False)
            print(f"\nBy hand: PORTTAPE_MUTANT={number} PROGRAM, of {os.path.relpath(project.BUILD)}/tests/{room}"
                  f"\nIts entry for equivalent.list:\n\n{equivalent.entry_of(place)}")
            return 0
    print(f"the last build has no mutant {number}", file=sys.stderr)
    return 1


def check_list(jobs):
    entries = equivalent.read(HERE / "equivalent.list")
    names = {entry.file for entry in entries}
    rooms = [room for room in project.rooms_below() if names & set(project.sources_of(room))]
    found = [place for some in all_places(rooms, jobs, names).values() for place in some] if entries else []
    stale = [entry for entry in entries if not any(entry.matches(place) for place in found)]
    for entry in stale:
        print(f"equivalent.list: no mutant is: {entry.file}: {entry.line}: {entry.kind}: {entry.change}")
    return 1 if stale else 0


def choose(given):
    """The plan to build and the mutants to try of it."""
    last = Plan.last()
    if given.only:
        rooms = names_of(given.only, last.mutants)
        found = all_places(list(rooms), given.jobs, {name for some in rooms.values() for name in some})
        chosen = selected(given.only, found, last.mutants)
        known = last.holds(chosen)
        if known is not None:
            return last, known
    else:
        found = all_places(given.rooms, given.jobs)
        if given.changed_since:
            lines = changed_lines(given.changed_since)
            found = {room: [place for place in some if place.line in lines.get(place.file, ())]
                     for room, some in found.items()}
        if given.kind:
            found = {room: [place for place in some if place.kind in given.kind] for room, some in found.items()}
        say(f"{sum(map(len, found.values()))} places in {len(found)} rooms")
        chosen = draw(found, given.count or (sys.maxsize if given.changed_since else 500), given.seed)
    plan = Plan([(number, room, place) for number, (room, place) in enumerate(chosen, 1)])
    return plan, plan.mutants


def try_all(given, plan, mutants):
    below = project.rooms_below()
    of_mutants = {room for _, room, _ in mutants}
    needed = {room for room in below if room in of_mutants or below[room] & of_mutants}
    workers = trial.Workers(given.jobs)
    if not workers.private:
        say("no private namespaces here (they need root): a mutant can reach the files of this machine")
    results = []
    try:
        with concurrent.futures.ThreadPoolExecutor(given.jobs) as pool:
            size = max((number for number, _, _ in plan.mutants), default=0) + 1
            tests, simulation = measured(workers, needed, bool(trial.SCRIPTED & of_mutants), size, given.seeds, pool)
            scripts = sum(test.is_script for test in tests)
            say(f"{len(tests) - scripts} unit tests, of which "
                f"{sum(test.seconds >= trial.QUICK for test in tests if not test.is_script)} are not quick; {scripts} scripts; "
                f"the simulation takes {simulation[2]:.0f} s; {len(mutants)} mutants")
            futures = {}
            for number, room, place in mutants:
                above = [test for test in tests if test.is_script or test.room == room or room in below[test.room]]
                futures[pool.submit(workers.use, trial.judge, number, room, above, simulation)] = (number, room, place)
            try:
                for done, future in enumerate(concurrent.futures.as_completed(futures), 1):
                    number, room, place = futures[future]
                    verdict = future.result()
                    results.append((number, room, place, verdict))
                    if given.verbose:
                        print(f"{number}: {place}: " + (f"{verdict.how}: {verdict.by}" if verdict.found
                                                        else f"SURVIVES: {verdict.by}"), flush=True)
                    progress(f"{done} of {len(mutants)} mutants, {sum(not each[3].found for each in results)} survive")
            except BaseException:
                for future in futures:
                    future.cancel()
                workers.stop(at_once=True)
                raise
    finally:
        workers.stop()
    progress("")
    return sorted(results, key=lambda each: each[0])


def main():
    given, parser = arguments()
    if given.show is not None:
        return show(given.show)
    begin = time.monotonic()
    project.WORK.mkdir(parents=True, exist_ok=True)
    with open(project.WORK / "lock", "w", encoding="utf-8") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("tests/mutants/run: another one runs in build/mutants", file=sys.stderr)
            return 1
        if given.check_list:
            return check_list(given.jobs)
        try:
            plan, mutants = choose(given)
        except ValueError as error:
            parser.error(str(error))
        if given.list:
            for _, _, place in mutants:
                print(place)
            return 0
        if not mutants:
            say("no mutant to try")
            return 0
        say("build")
        plan, dropped = build(plan, given.jobs)
        plan.save()
        gone = {number for number, _, _ in dropped}
        mutants = [each for each in mutants if each[0] not in gone]
        say(f"built ({time.monotonic() - begin:.0f} s)")
        results = try_all(given, plan, mutants)
    rooms = [room for room in project.rooms_below() if any(each[1] == room for each in results)]
    report = Report(rooms, results, equivalent.read(HERE / "equivalent.list"))
    how = " ".join(shlex.quote(each) for each in sys.argv[1:])
    report.write(given.survivors, f"Survivors of tests/mutants/run {how}".strip())
    for number, _, place, verdict in report.survivors():
        print(f"survives: {place}  [{number}: {verdict.by}]")
    print("", *report.table(), "", f"Found of each kind: {report.kinds()}.", sep="\n")
    if dropped:
        print(f"{len(dropped)} drawn mutants did not compile and were not tried.")
    faults = [] if given.only else report.faults()
    for fault in faults:
        print(f"too few: {fault}" if "equivalent.list" not in fault else f"too many: {fault}")
    ways = collections.Counter("hangs" if each[3].how == "hangs" else "crashes" if each[3].how.startswith("signal")
                               else "a bound of time" if "bound" in each[3].how else "fails"
                               for each in results if each[3].found)
    say(f"{len(results)} mutants in {time.monotonic() - begin:.0f} s; found by: "
        + ", ".join(f"{name} {count}" for name, count in ways.most_common()))
    return 1 if faults or (given.only and report.survivors()) else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except project.BuildFailed as failed:
        print(failed, file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)
