"""Tests that fail, each in its own way."""
import os

import pytest


def write(port, text):
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
    try:
        os.write(fd, text)
        if not os.read(fd, 100):
            raise OSError("the line ended")
    finally:
        os.close(fd)


@pytest.mark.porttape("tapes/ask")
def test_other_data(porttape):
    with pytest.raises(OSError):
        write(porttape.port, b"axk\n")


@pytest.mark.porttape("tapes/ask")
def test_other_data_and_an_error(porttape):
    write(porttape.port, b"axk\n")


@pytest.mark.porttape("tapes/ask")
def test_nothing_written(porttape):
    pass


@pytest.mark.porttape("tapes/ask")
def test_own_error(porttape):
    assert 1 == 2


@pytest.mark.porttape("tapes/ask")
def test_skipped_behind_other_data(porttape):
    with pytest.raises(OSError):
        write(porttape.port, b"axk\n")
    pytest.skip("not here")


@pytest.mark.porttape("tapes/ask")
def test_expected_behind_other_data(porttape):
    with pytest.raises(OSError):
        write(porttape.port, b"axk\n")
    pytest.xfail("known")


@pytest.mark.porttape("tapes/none")
def test_no_tape(porttape):
    pass


@pytest.mark.porttape("tapes/ask", strictness=3)
def test_wrong_option(porttape):
    pass


def test_no_marker(porttape):
    pass


@pytest.mark.porttape("tapes/ask")
def test_no_fixture():
    pass


@pytest.mark.porttape("tapes/ask")
class TestClass:
    def test_no_fixture_in_a_class(self):
        pass

    def test_wrong_data_in_a_class(self, porttape):
        with pytest.raises(OSError):
            write(porttape.port, b"axk\n")


@pytest.mark.porttape("tapes/none")
class TestClassWithoutATape:
    def test_no_tape_in_a_class(self, porttape):
        pass
