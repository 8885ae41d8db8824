"""The ways of a driver that a pty is not enough for: on one, where it fails, and three times under porttape exec."""

import json
import re

from parts.tape import Tape
from parts.ways import Result, Ways, compare, compare_tape, describe, failure, last_words


def outcome(finished):
    """What the driver found, as its script tells it."""
    mark = "outcome: "
    return [line.removeprefix(mark) for line in finished.said.splitlines() if line.startswith(mark)]


def compare_outcomes(expected, got):
    differing = [(a, b) for a, b in zip(expected, got) if a != b]
    if differing:
        return [f"it found {differing[0][1]!r}, directly {differing[0][0]!r}"]
    return [] if len(expected) == len(got) else [f"it found {len(got)} things, directly {len(expected)}"]


class ExecWays(Ways):
    def all(self, case, folder):
        case.prepare(folder)
        if case.exec.refused:
            yield self._on_pty(case, folder)
        direct, seen, found = self._under_exec(case, folder)
        yield direct
        if direct.wrong:
            return
        yield self._under_exec_recorded(case, folder, seen, found)
        if (folder / "tape.loge").exists():
            yield self._against_tape(case, folder, found)

    def _device(self, case, path):
        options = f",{case.device_options}" if case.device_options else ""
        return ["--device", f"serial:{path},baud={case.baud}{options}"]

    def _on_pty(self, case, folder):
        finished, _, _ = self._on_far_end(case, folder, "pty", lambda path, script: script(path))
        wrong = []
        if finished.status == 0:
            wrong.append("it is right on a plain pty, too: it shows nothing here")
        elif not re.search(case.exec.refused, finished.said):
            wrong.append(f"it fails otherwise than by {case.exec.refused!r}: {last_words(finished.said)}")
        return Result("pty", wrong, [f"it fails, as expected: {last_words(finished.said)[:120]}"], finished.seconds)

    def _under_exec(self, case, folder):
        def command(path, script):
            return [self._porttape, "exec", *self._device(case, path), *case.exec.live, "--", *script("{port}")]

        finished, seen, wrong = self._on_far_end(case, folder, "direct", command)
        return Result("direct", wrong, [describe(seen)], finished.seconds), seen, outcome(finished)

    def _under_exec_recorded(self, case, folder, direct, found):
        def command(path, script):
            return [self._porttape, "exec", *self._device(case, path), "--tape", str(folder / "tape"), "--overwrite",
                    *case.exec.live, "--", *script("{port}")]

        finished, seen, wrong = self._on_far_end(case, folder, "recorded", command)
        notes = [describe(seen)]
        if not wrong:
            tape = Tape(folder / "tape")
            wrong = compare(direct, seen, case.settings_reach) + compare_tape(tape, seen, direct.settings)
            wrong += compare_outcomes(found, outcome(finished))
            fault = case.exec.tape(tape)
            wrong += [f"on the tape: {fault}"] if fault else []
            notes.append(f"on the tape: {tape.count('settings')} settings, {tape.count('flush')} flushes, "
                         f"{tape.count('modem')} signals, {tape.count('break')} breaks")
        return Result("recorded", wrong, notes, finished.seconds)

    def _against_tape(self, case, folder, found):
        """Twice: with a verdict, and as a port that plays the tape."""
        report = folder / "report.json"
        report.unlink(missing_ok=True)
        checks = ["--check-settings"] if case.settings_checked else []
        tape = ["--tape", str(folder / "tape"), *case.replay, *case.exec.replayed]
        script = self._script(case.replay_script or case.script, "{port}")
        tested = self._run(case, folder, "tested", [self._porttape, "test", "--exec", *tape, *checks,
                                                    "--report", str(report), "--", *script])
        wrong = [f"porttape test: {reason}" for reason in failure(tested) + compare_outcomes(found, outcome(tested))]
        if report.exists():
            told = json.loads(report.read_text())
            if told["verdict"] != "pass":
                wrong.append(f"verdict {told['verdict']}: {json.dumps(told['mismatch'])}")
        elif not wrong:
            wrong.append("no report")
        played = self._run(case, folder, "replayed", [self._porttape, "exec", *tape, "--", *script])
        wrong += [f"porttape exec: {reason}" for reason in failure(played) + compare_outcomes(found, outcome(played))]
        return Result("replayed", wrong, [f"under porttape exec {played.seconds:.1f} s"], tested.seconds)
