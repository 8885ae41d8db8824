"""A module whose marker is for all of its tests."""
import os

import pytest

pytestmark = pytest.mark.porttape("tapes/ask")


def ask(port):
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
    os.write(fd, b"ask\n")
    assert os.read(fd, 3) == b"42\n"
    os.close(fd)


def test_by_the_modules_marker(porttape):
    ask(porttape.port)


class TestClass:
    def test_by_the_modules_marker_in_a_class(self, porttape):
        ask(porttape.port)


def test_a_fork_that_is_alive_holds_nothing_up(porttape, monkeypatch):
    monkeypatch.setattr("porttape._END_LIMIT_S", 600.0)  # that it would wait for
    here, there = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(there)
        os.read(here, 1)  # until the test is over
        os._exit(0)
    ask(porttape.port)
    assert porttape.finish().passed
    os.close(there)
    os.waitpid(child, 0)


def test_a_fork_that_ends_leaves_the_run_alone(porttape):
    child = os.fork()
    if child == 0:
        del porttape
        os._exit(0)
    os.waitpid(child, 0)
    ask(porttape.port)
    assert porttape.finish().passed and porttape.finish().report["verdict"] == "pass"
