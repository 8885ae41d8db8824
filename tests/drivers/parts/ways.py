"""The three ways of running a driver, and what makes each right."""

import json
import shutil
import subprocess

from far.end import FarEnd
from parts import history, programs
from parts.case import ROOT
from parts.tape import Tape

CLOSE_SECONDS = 10


class Result:
    """One way of one run: what was wrong with it (nothing: it is right), and what is worth knowing."""

    def __init__(self, way, wrong, notes, seconds):
        self.way, self.wrong, self.notes, self.seconds = way, wrong, notes, seconds


class Seen:
    """What the far end saw of a run."""

    def __init__(self, case, line):
        self.received, self.sent = bytes(line.received), bytes(line.sent)
        self.own = line.own
        self.settings = history.made_by_driver(history.held(line.sessions), line.own)
        self.flushes = len(line.flushes)
        self.comparable = case.comparable(self.received)


class Ways:
    def __init__(self, porttape):
        self._porttape = str(porttape)
        told = subprocess.run([self._porttape, "test", "--help"], capture_output=True, text=True).stdout
        self._checks_settings = "--check-settings" in told

    def all(self, case, folder):
        """The results of a run, one by one. What comes after a way that is wrong has nothing to be compared with."""
        case.prepare(folder)
        direct, seen = self._direct(case, folder)
        yield direct
        if direct.wrong:
            return
        recorded = self._recorded(case, folder, seen)
        yield recorded
        if (folder / "tape.loge").exists():
            yield self._replayed(case, folder)

    def _direct(self, case, folder):
        """Of a driver that opens the device's line itself: (Result, Seen)."""
        finished, seen, wrong = self._on_far_end(case, folder, "direct", lambda path, script: script(path))
        return Result("direct", wrong, [describe(seen)], finished.seconds), seen

    def _recorded(self, case, folder, direct):
        def command(path, script):
            options = f",{case.device_options}" if case.device_options else ""
            return [self._porttape, "record", "--device", f"serial:{path},baud={case.baud}{options}",
                    *driver_port(folder), "--tape", str(folder / "tape"), "--overwrite", "--", *script("{port}")]

        finished, seen, wrong = self._on_far_end(case, folder, "recorded", command)
        notes = [describe(seen)]
        if not wrong:
            tape = Tape(folder / "tape")
            wrong = compare(direct, seen, case.settings_reach) + compare_tape(tape, seen, direct.settings)
            notes.append(f"on the tape: {tape.count('settings')} settings, {tape.count('flush')} flushes")
        return Result("recorded", wrong, notes, finished.seconds)

    def _replayed(self, case, folder):
        report = folder / "report.json"
        report.unlink(missing_ok=True)
        checks = self._checks_settings and case.settings_checked
        options = ["--check-settings"] if checks else []
        script = case.replay_script or case.script
        finished = self._run(case, folder, "replayed", [
            self._porttape, "test", "--tape", str(folder / "tape"), "--report", str(report), *driver_port(folder),
            *options, *case.replay, "--", *self._script(script, "{port}")])
        notes = [] if checks else ["settings not checked"]
        if not report.exists():
            return Result("replayed", failure(finished) or ["no report"], notes, finished.seconds)
        told = json.loads(report.read_text())
        if "lookup" in told:
            notes.append(f"{told['lookup']['answered']} requests answered")
        excuse = told["command_exit"] == 0 and told["verdict"] != "pass" and case.forgives(told)
        wrong = [] if excuse else failure(finished)
        if excuse:
            notes.append(excuse)
        elif told["verdict"] != "pass":
            wrong.append(f"verdict {told['verdict']}: {json.dumps(told['mismatch'])}")
        return Result("replayed", wrong, notes, finished.seconds)

    def _on_far_end(self, case, folder, way, command):
        """Runs the driver on a new device. (Finished, Seen, what is wrong)"""
        far_folder = folder / f"far.{way}"
        shutil.rmtree(far_folder, ignore_errors=True)
        far_folder.mkdir()
        device = case.device(far_folder)
        line = FarEnd(device, case.baud)
        line.start()
        try:
            finished = self._run(case, folder, way, command(line.path, lambda port: self._script(case.script, port)))
            closed = line.wait_closed(CLOSE_SECONDS)
        finally:
            line.stop()
            device.end()
        wrong = failure(finished)
        if line.error:
            wrong.append(f"the far end failed: {line.error!r}")
        if not closed:
            wrong.append(f"the line is not closed {CLOSE_SECONDS} s after the driver's end")
        if not line.sessions:
            wrong.append("the line was never opened")
        fault = case.judge(device, far_folder)
        if fault:
            wrong.append(f"at the far end: {fault}")
        return finished, Seen(case, line), wrong

    def _script(self, script, port):
        return [str(ROOT / "tests/drivers" / script[0]), port, *script[1:]]

    def _run(self, case, folder, way, command):
        return programs.run(command, case.seconds, folder / f"{way}.said", {"DRIVER_FOLDER": str(folder)})


def driver_port(folder):
    """Some drivers drop their privileges before they open their port."""
    return ["--driver", f"pty:{folder / 'port'},mode=0666"]


def failure(finished):
    wrong = []
    if finished.status is None:
        wrong.append(f"not at its end after {finished.seconds:.0f} s: {last_words(finished.said)}")
    elif finished.status:
        wrong.append(f"status {finished.status}: {last_words(finished.said)}")
    wrong += [line for line in finished.said.splitlines() if line.startswith("left running: ")]
    return wrong


def last_words(said):
    return " | ".join(said.splitlines()[-4:])[-500:] or "it said nothing"


def describe(seen):
    return (f"{len(seen.received)} bytes to the device, {len(seen.sent)} from it, {seen.flushes} flushes seen, "
            f"settings made: {history.text(seen.settings)}")


def compare(direct, recorded, settings_reach):
    """How what reached the device recorded differs from what reached it directly."""
    wrong = []
    if direct.comparable != recorded.comparable:
        wrong.append("other bytes than directly: " + first_difference(direct.comparable, recorded.comparable))
    expected = direct.settings if settings_reach else []
    if recorded.settings != expected:
        wrong.append(f"settings at the far end: expected {history.text(expected)}; "
                     f"got {history.text(recorded.settings)}")
    return wrong


def compare_tape(tape, seen, settings):
    """How the tape differs from what the far end saw when it was made, and from the settings the driver makes."""
    wrong = []
    if tape.written != seen.received:
        wrong.append("the tape's w differs from what reached the device: "
                     + first_difference(seen.received, tape.written))
    if not seen.sent.startswith(tape.read):
        wrong.append("the tape's r differs from what the device sent: " + first_difference(seen.sent, tape.read))
    told = history.made_by_driver(history.held(tape.sessions()), seen.own)
    if told != settings:
        wrong.append(f"settings on the tape: expected {history.text(settings)}; got {history.text(told)}")
    return wrong


def first_difference(expected, got):
    at = next((n for n, (a, b) in enumerate(zip(expected, got)) if a != b), min(len(expected), len(got)))
    return (f"at byte {at} of {len(expected)} and {len(got)}: expected {expected[at:at + 24]!r}, got "
            f"{got[at:at + 24]!r} after {expected[max(0, at - 12):at]!r}")
