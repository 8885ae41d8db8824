#!/usr/bin/env python3
"""modbus_slave_test.py TAPE: the slave in Python answers each request of that tape of the libmodbus slave as recorded."""
import os
import subprocess
import sys

HERE = os.path.dirname(os.path.realpath(__file__))
sys.path.insert(0, HERE)
import modbus_slave  # noqa: E402


class Requests:
    """Recorded requests in the place of a Line."""

    def __init__(self, data):
        self.data = data

    def read_exactly(self, size, _seconds):
        part, self.data = self.data[:size], self.data[size:]
        return part


def payload(name):
    return subprocess.check_output([sys.executable, os.path.join(HERE, "tapefile.py"), "payload", name])


def main(tape):
    requests, recorded, meter = Requests(payload(tape + "w")), payload(tape + "r"), modbus_slave.Meter()
    answers, count = b"", 0
    while requests.data:
        frame = modbus_slave.read_request(requests)
        assert modbus_slave.crc(frame[:-2]) == frame[-2:], f"request {count}: {frame!r}"
        answer = bytes([modbus_slave.SLAVE]) + meter.answer(frame[1:-2])
        answers += answer + modbus_slave.crc(answer)
        count += 1
    assert count == 10, f"{count} requests"
    assert answers == recorded, f"{answers.hex()} where the tape has {recorded.hex()}"
    unknown = meter.answer(bytes([43, 14, 1, 0]))
    assert unknown == bytes([43 | 0x80, modbus_slave.ILLEGAL_FUNCTION]), unknown


main(sys.argv[1])
