"""A test that passes, of which something is not sure."""
import os

import pytest


@pytest.mark.porttape("tapes/ask")
def test_that_leaves_the_answer_unread(porttape):
    fd = os.open(porttape.port, os.O_RDWR | os.O_NOCTTY)
    os.write(fd, b"ask\n")
    assert os.read(fd, 1) == b"4"
    os.close(fd)
