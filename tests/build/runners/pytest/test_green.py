"""Tests that pass."""
import os
import socket
import subprocess

import pytest


@pytest.mark.porttape("tapes/bug_meter", rate=4)
def test_meter(porttape, client):
    subprocess.run([client, porttape.port, "--fixed"], check=True)


@pytest.mark.porttape("tapes/ask")
@pytest.mark.parametrize("number", range(20))
def test_ask(porttape, number):
    fd = os.open(porttape.port, os.O_RDWR | os.O_NOCTTY)
    os.write(fd, b"ask\n")
    assert os.read(fd, 3) == b"42\n"
    os.close(fd)


@pytest.mark.porttape("tapes/ask", driver="tcp-listen:127.0.0.1:0", strictness=1)
def test_socket(porttape):
    assert porttape.port == f"{porttape.host}:{porttape.tcp_port}"
    with socket.create_connection((porttape.host, porttape.tcp_port)) as line:
        line.sendall(b"ask\n")
        assert line.recv(3) == b"42\n"


@pytest.mark.porttape("tapes/ask")
def test_skips_itself(porttape):
    pytest.skip("whatever the verdict is")


@pytest.mark.porttape("tapes/ask")
def test_looks_at_the_verdict(porttape):
    verdict = porttape.finish()
    assert verdict.exit_status == 5 and verdict.report["verdict"] == "incomplete"
    pytest.skip("and it stands")
