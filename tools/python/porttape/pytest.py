"""A pytest plugin: each test gets a port with a tape behind it, and fails where its driver does.

    # conftest.py
    pytest_plugins = ["porttape.pytest"]

    # test_laser.py
    @pytest.mark.porttape("tapes/laser")
    def test_laser(porttape):
        subprocess.run(["./laser_driver", porttape.port], check=True)

The tape's name is relative to the test's file; further arguments of the marker are the options of
`porttape test`, with `_` for `-` (strictness=2, driver="tcp-listen:127.0.0.1:0"). A test whose driver does
not do as recorded fails with the report, and no traceback. It works in parallel under pytest-xdist.
"""
from __future__ import annotations

import pathlib
from collections.abc import Generator
from typing import Any

import pytest

from porttape import Error, Replay, Verdict

_MARKER = 'porttape(tape, **options): the tape that the fixture "porttape" plays, and the options of `porttape test`'
_KEY: pytest.StashKey[Replay] = pytest.StashKey()
_PATHS = ("rules", "faults")  # options that name a file, which may be beside the test


def pytest_configure(config: pytest.Config) -> None:
    """Makes the marker known."""
    config.addinivalue_line("markers", _MARKER)


def _beside(folder: pathlib.Path, option: str, value: object) -> object:
    """A file of the test's folder by its path; anything else as it is."""
    if option in _PATHS and isinstance(value, str) and (folder / value).exists():
        return folder / value
    return value


def _start(replay: Replay) -> str:
    """Starts it; what is wrong, or nothing."""
    try:
        replay.start()
    except (Error, OSError) as error:
        return str(error)
    return ""


@pytest.fixture
def porttape(request: pytest.FixtureRequest) -> Generator[Replay, None, None]:
    """The tape of the test's marker in a device's place: `.port` is what the driver is to open."""
    marker = request.node.get_closest_marker("porttape")
    if marker is None or len(marker.args) != 1:
        pytest.fail('the test names no tape: @pytest.mark.porttape("tapes/laser")', pytrace=False)
    folder = request.path.parent
    options = {name: _beside(folder, name, value) for name, value in marker.kwargs.items()}
    replay = Replay(folder / marker.args[0], **options)
    problem = _start(replay)
    if problem:
        pytest.fail(f"porttape: {problem}", pytrace=False)
    request.node.stash[_KEY] = replay
    try:
        yield replay
    finally:
        replay.finish()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """A marker alone plays nothing: such a test would pass whatever the driver did."""
    marked = item.get_closest_marker("porttape") is not None  # its own, its class's or its module's
    if not marked or "porttape" in getattr(item, "fixturenames", ()):
        return
    pytest.fail("the test has a tape, which only its fixture plays: def test_laser(porttape)", pytrace=False)


def _own_error(item: pytest.Item, error: BaseException) -> str:
    """Where the test itself failed, in a line."""
    place = ""
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(item.path):
            place = f"{item.path.name}:{trace.tb_lineno}: "
        trace = trace.tb_next
    lines = str(error).splitlines()
    return f"the test then failed itself: {place}{type(error).__name__}: {lines[0] if lines else ''}"


def _failure(item: pytest.Item, verdict: Verdict, error: BaseException | None) -> str | None:
    """What the test is to fail with: the report, unless the test's own error is what came first."""
    if verdict.passed or isinstance(error, KeyboardInterrupt):
        return None
    if error is None:
        return verdict.text
    # Where the line was hung up at a mismatch, the test's error is what came of that.
    says_of_itself = isinstance(error, (pytest.skip.Exception, pytest.xfail.Exception))
    if verdict.report.get("mismatch") and not says_of_itself:
        return f"{verdict.text}\n{_own_error(item, error)}"
    item.add_report_section("call", "porttape", verdict.text)
    return None


def _tell_doubts(item: pytest.Item, verdict: Verdict) -> None:
    """A test that passed with doubts has not simply passed."""
    doubts = verdict.report.get("doubts") or []
    for doubt in doubts:
        item.warn(pytest.PytestWarning(f"porttape: doubt: {doubt['text']}"))
    if doubts and verdict.passed:
        item.add_report_section("call", "porttape", verdict.text)


@pytest.hookimpl(hookwrapper=True, tryfirst=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, None]:
    """Ends the replay with the test's own code, so that the verdict is the test's and not its teardown's."""
    outcome = yield
    replay = item.stash.get(_KEY, None)
    if replay is None:
        return
    error = outcome.excinfo[1] if outcome.excinfo else None
    try:
        verdict = replay.finish()
        _tell_doubts(item, verdict)
        failure = _failure(item, verdict, error)
    except Error as problem:
        failure = f"porttape: {problem}"
    if failure is None:
        return
    failed = pytest.fail.Exception(failure, pytrace=False)
    if hasattr(outcome, "force_exception"):  # pluggy 1.1
        outcome.force_exception(failed)
        return
    raise failed
