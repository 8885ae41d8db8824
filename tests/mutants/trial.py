"""Runs the tests: which mutants each one reaches, and which one notices a mutant."""

import dataclasses
import hashlib
import json
import os
import queue
import re
import signal
import subprocess
import sys

import copy_of_sources

# Seconds that a unit test takes without a mutant. Those of a program that are fast run first. Those that are not quick run
# last, and only for mutants of their own room; slow ones do not run.
FAST, QUICK, SLOW = 0.1, 2, 20
# The rooms of whole programs, whose tests are the scripts of tests/e2e, too; a script that takes longer is left out.
SCRIPTED, SCRIPT_LIMIT = {"formats", "supervise", "tools", "daemon"}, 40
PATIENCE, FACTOR = 30, 10  # a run may take PATIENCE seconds and FACTOR times what it took without a mutant
SPIN = 10  # seconds of the processor that a process may use besides
SIMULATION_LIMIT = 900
BOUND_OF_TIME, SKIPPED = 75, 77
UNSHARE = ["unshare", "--mount", "--pid", "--fork", "--kill-child=KILL", "--mount-proc", "--net"]
WORKER = os.path.join(os.path.dirname(os.path.realpath(__file__)), "worker.py")


@dataclasses.dataclass
class Test:
    room: str
    program: str
    name: str
    cwd: str
    environment: dict
    seconds: float = 0
    reaches: frozenset = frozenset()
    arguments: tuple = ()  # of a script

    @property
    def is_script(self):
        return self.room == "e2e"

    @property
    def command(self):
        return [self.program, *(self.arguments if self.is_script else [f"--gtest_filter={self.name}"])]


@dataclasses.dataclass
class Verdict:
    found: bool
    by: str  # the test that found it, or which tests reach it
    how: str = ""  # fails, hangs, crashes
    runs: int = 0
    seconds: float = 0


class Worker:
    """One worker.py; it is started again if it ends."""

    def __init__(self, private):
        self.private, self.process = private, None

    def start(self):
        keep = [str(copy_of_sources.ROOT), str(copy_of_sources.ROOT.parent / "shared")]
        command = [*(UNSHARE if self.private else []), sys.executable, "-B", WORKER,
                   "private" if self.private else "shared", *filter(os.path.isdir, keep)]
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PORTTAPE_MUTANT")}
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment,
                                        start_new_session=True)
        if json.loads(self.process.stdout.readline() or "{}").get("ready") is not True:
            raise RuntimeError("a worker does not start")

    def run(self, command, cwd, limit, mutant=0, cpu=0, reach=0, environment=()):
        if self.process is None:
            self.start()
        order = {"command": command, "cwd": cwd, "limit": limit, "cpu": int(cpu), "reach": reach,
                 "env": {**dict(environment), "PORTTAPE_MUTANT": str(mutant)}}
        self.process.stdin.write(json.dumps(order) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            self.stop()
            raise RuntimeError(f"a worker ended during {' '.join(command)[:200]}")
        return json.loads(line)

    def stop(self, at_once=False):
        """Ends it and all that it runs; `at_once` during a run, of another thread."""
        if at_once:
            if self.process is not None:
                self.process.send_signal(signal.SIGKILL if self.private else signal.SIGTERM)
        elif self.process is not None:
            self.process.stdin.close()
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
            self.process.stdout.close()
            self.process = None


class Workers:
    """As many as tests run at once."""

    def __init__(self, count):
        can = subprocess.run([*UNSHARE, "true"], stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
        self.private = os.geteuid() == 0 and can.returncode == 0
        self.all = [Worker(self.private) for _ in range(count)]
        self.free = queue.SimpleQueue()
        for worker in self.all:
            self.free.put(worker)

    def use(self, function, *arguments):
        worker = self.free.get()
        try:
            return function(worker, *arguments)
        finally:
            self.free.put(worker)

    def stop(self, at_once=False):
        for worker in self.all:
            worker.stop(at_once)


def listed_tests(rooms, scripts=False):
    """The tests of ctest's list that may run beside others: those of GoogleTest of these rooms, and the scripts."""
    listed = subprocess.run(["ctest", "--test-dir", copy_of_sources.BUILD, "--show-only=json-v1"], check=True,
                            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True).stdout
    found = []
    for test in json.loads(listed)["tests"]:
        command = test.get("command", [])
        properties = {each["name"]: each["value"] for each in test.get("properties", [])}
        if len(command) < 1 or {"RUN_SERIAL", "RESOURCE_LOCK"} & properties.keys():
            continue
        of_google = len(command) >= 2 and command[1].startswith("--gtest_filter=")
        room = os.path.basename(os.path.dirname(command[0])) if of_google else "e2e"
        wanted = room in rooms if of_google else scripts and properties.get("LABELS") == ["e2e"]
        if wanted:
            environment = dict(each.split("=", 1) for each in properties.get("ENVIRONMENT", []))
            name = command[1].removeprefix("--gtest_filter=") if of_google else test["name"]
            found.append(Test(room, command[0], name, properties.get("WORKING_DIRECTORY", str(copy_of_sources.BUILD)),
                              environment, arguments=tuple(command[1:])))
    return found


def programs_of_scripts():
    """What a script tests: it is measured again where one of them has changed."""
    return [str(copy_of_sources.BUILD / name) for name in ("daemon/porttaped", "tools/porttape")]


def digest(path):
    with open(path, "rb") as file:
        return hashlib.sha256(file.read()).hexdigest()


class Measures:
    """What each test takes and reaches without a mutant. A program that is as it was is not measured again."""

    def __init__(self, size):
        self.size = size
        self.path = copy_of_sources.WORK / "measures.json"
        self.programs = {}
        try:
            self.known = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            self.known = {}

    def key(self, program, name):
        if program not in self.programs:
            self.programs[program] = digest(program)
        return f"{self.programs[program]} {self.size} {name}"

    def measure(self, worker, test):
        """[seconds, numbers], or None for a test that does not pass, or a script that takes too long."""
        name = test.name
        if test.is_script:
            name += " " + " ".join(self.key(program, "") for program in programs_of_scripts())
        key = self.key(test.program, name)
        if key not in self.known:
            told = worker.run(test.command, test.cwd, 60 if not test.is_script else 2 * SCRIPT_LIMIT, reach=self.size,
                              environment=test.environment)
            passed = told["status"] == 0 and "[  SKIPPED ]" not in told["output"]
            self.known[key] = [told["seconds"], told["reached"]] if passed else None
            if told["status"] not in (0, SKIPPED):
                print(f"without a mutant {test.name} fails here, and is left out: {told['output'][-600:]}", file=sys.stderr)
        known = self.known[key]
        return None if known is not None and test.is_script and known[0] > SCRIPT_LIMIT else known

    def simulation(self, worker, program, seeds):
        key = self.key(program, f"seeds {seeds}")
        if key not in self.known:
            told = worker.run([program, "--seeds", f"1..{seeds}", "--stop"], "/", SIMULATION_LIMIT, reach=self.size)
            if told["status"] != 0:
                raise RuntimeError("the simulation finds something without a mutant: " + told["output"])
            self.known[key] = [told["seconds"], told["reached"]]
        return self.known[key]

    def save(self, used):
        """Keeps what these programs need, so that the file does not grow for ever."""
        digests = {self.programs[program] for program in used if program in self.programs}
        kept = {key: value for key, value in self.known.items() if key.split()[0] in digests}
        self.path.write_text(json.dumps(kept), encoding="utf-8")


def failed_tests(output):
    """The test that ended a run of GoogleTest: the first that failed, or the last that began."""
    failed = re.findall(r"^\[  FAILED  \] ([^\s,.]+\.[^\s,]+)", output, re.MULTILINE)
    begun = re.findall(r"^\[ RUN      \] (\S+)", output, re.MULTILINE)
    return failed[0] if failed else begun[-1] if begun else ""


def batches(room, tests):
    """The tests in the order in which they are tried: [(program, tests)]. First the room's own, then the rooms above, and
    at last what is left of the room's own."""
    programs = {}
    for test in tests:
        programs.setdefault(test.program, []).append(test)
    own_first = sorted(programs.values(), key=lambda some: (some[0].room != room, sum(test.seconds for test in some)))
    result = []
    for own, least, most in ((True, 0, FAST), (True, FAST, QUICK), (False, 0, FAST), (False, FAST, QUICK),
                             (True, QUICK, SLOW)):
        for some in own_first:
            part = [test for test in some if least <= test.seconds < most]
            if part and (some[0].room == room) == own:
                result.append((part[0].program, part))
    return result


def how_it_ended(told):
    if told["late"] or told["status"] == -24:  # SIGXCPU
        return "hangs"
    return f"signal {-told['status']}" if told["status"] < 0 else "fails"


def judge_batch(worker, number, program, tests, verdict):
    """Whether one of these tests of a program notices the mutant. A failure counts if the test fails again alone."""
    left = list(tests)
    while left:
        total = sum(test.seconds for test in left)
        told = worker.run([program, "--gtest_filter=" + ":".join(test.name for test in left), "--gtest_fail_fast",
                           "--gtest_brief=0"], left[0].cwd, PATIENCE + FACTOR * total, mutant=number,
                          cpu=SPIN + FACTOR * total, environment=left[0].environment)
        verdict.runs += 1
        verdict.seconds += told["seconds"]
        if told["status"] == 0 and not told["late"]:
            return False
        name, how = failed_tests(told["output"]), how_it_ended(told)
        if how != "fails":
            verdict.by, verdict.how = name or os.path.basename(program), how
            return True
        alone = [test for test in left if test.name == name]
        if not alone:  # it ended before a test began, or by itself
            verdict.by, verdict.how = os.path.basename(program), f"ends with status {told['status']}"
            return True
        again = worker.run([program, f"--gtest_filter={name}"], alone[0].cwd, PATIENCE + FACTOR * alone[0].seconds,
                           mutant=number, cpu=SPIN + FACTOR * alone[0].seconds, environment=alone[0].environment)
        verdict.runs += 1
        verdict.seconds += again["seconds"]
        if again["status"] != 0 or again["late"]:
            verdict.by, verdict.how = name, "only a bound of time" if again["status"] == BOUND_OF_TIME else "fails"
            return True
        left = [test for test in left if test.name != name]
    return False


def judge_script(worker, number, test, verdict):
    """Whether a script notices the mutant, twice."""
    for _ in range(2):
        told = worker.run(test.command, test.cwd, PATIENCE + FACTOR * test.seconds, mutant=number,
                          cpu=SPIN + FACTOR * test.seconds, environment=test.environment)
        verdict.runs += 1
        verdict.seconds += told["seconds"]
        if told["status"] in (0, SKIPPED) and not told["late"]:
            return False
        verdict.by, verdict.how = test.name, how_it_ended(told)
        if verdict.how != "fails":
            return True
    if told["status"] == BOUND_OF_TIME:
        verdict.how = "only a bound of time"
    return True


def judge(worker, number, room, tests, simulation):
    """Tries the tests that reach the mutant, the simulation (program, seeds, seconds, numbers reached), then the scripts."""
    verdict = Verdict(False, "")
    scripts = [test for test in tests if test.is_script and number in test.reaches] if room in SCRIPTED else []
    reaching = [test for test in tests if not test.is_script and number in test.reaches]
    program, seeds, seconds, reached = simulation
    for each, some in batches(room, reaching):
        if judge_batch(worker, number, each, some, verdict):
            verdict.found = True
            return verdict
    if number in reached:
        limit = PATIENCE + FACTOR * seconds
        told = worker.run([program, "--seeds", f"1..{seeds}", "--stop"], "/", limit, mutant=number,
                          cpu=SPIN + FACTOR * seconds)
        verdict.runs += 1
        verdict.seconds += told["seconds"]
        if told["status"] != 0 or told["late"]:
            seed = re.findall(r"^seed (\d+):", told["output"], re.MULTILINE)
            verdict.found, verdict.by = True, f"simulation, seed {seed[0]}" if seed else "simulation"
            verdict.how = how_it_ended(told)
            return verdict
    # Those that reach the least know the most of it.
    for script in sorted(scripts, key=lambda test: (len(test.reaches), test.seconds)):
        if judge_script(worker, number, script, verdict):
            verdict.found = True
            return verdict
    by = [f"{len(reaching)} tests"] if reaching else []
    by += ["the simulation"] if number in reached else []
    by += [f"{len(scripts)} scripts"] if scripts else []
    verdict.by, verdict.how = f"reached by {' and '.join(by)}" if by else "not reached", ""
    return verdict
