#!/usr/bin/python3
"""rfc2217_client.py TCP_PORT: sets rate after rate, stop bits and flow control at a terminal server (RFC 2217), and has
what it writes sent back by the device each time. It asks for nothing of the modem lines, which a pty has not.
"""

import socket
import struct
import sys

IAC, SE, SB, WILL, WONT, DO, DONT = 255, 240, 250, 251, 252, 253, 254
BINARY, COM_PORT = 0, 44
SET_BAUDRATE, SET_STOPSIZE, SET_CONTROL = 1, 4, 5
NO_FLOW_CONTROL, XON_XOFF, RTS_CTS = 1, 2, 3


class Client:
    def __init__(self, port):
        self._socket = socket.create_connection(("127.0.0.1", port), 10)
        self._raw = b""
        self._data = b""
        self._answers = []
        for option in (BINARY, COM_PORT):
            self._socket.sendall(bytes((IAC, WILL, option, IAC, DO, option)))

    def close(self):
        self._socket.close()

    def set(self, command, value):
        """Waits for the answer, which is the value that is set now."""
        self._socket.sendall(bytes((IAC, SB, COM_PORT, command)) + value.replace(b"\xff", b"\xff\xff") + bytes((IAC, SE)))
        wanted = bytes((COM_PORT, command + 100))
        while not any(answer.startswith(wanted) for answer in self._answers):
            self._take_more()
        answer = next(answer for answer in self._answers if answer.startswith(wanted))
        self._answers.remove(answer)
        if answer[2:] != value:
            sys.exit(f"command {command}: asked for {value.hex()}, answered {answer[2:].hex()}")

    def ask(self, question):
        self._socket.sendall(question)
        while len(self._data) < len(question):
            self._take_more()
        answer, self._data = self._data[:len(question)], self._data[len(question):]
        if answer != question:
            sys.exit(f"asked {question!r}, answered {answer!r}")

    def _take_more(self):
        got = self._socket.recv(4096)
        if not got:
            sys.exit("ser2net hung up")
        self._raw += got
        while self._take_one():
            pass

    def _take_one(self):
        """Takes data, or a telnet command, off what has come; whether there may be more."""
        at = self._raw.find(IAC)
        if at != 0:
            end = len(self._raw) if at < 0 else at
            self._data, self._raw = self._data + self._raw[:end], self._raw[end:]
            return end > 0
        if len(self._raw) < 3:
            return False
        if self._raw[1] != SB:
            self._raw = self._raw[3:]
            return True
        end = self._raw.find(bytes((IAC, SE)))
        if end < 0:
            return False
        self._answers.append(self._raw[2:end].replace(b"\xff\xff", b"\xff"))
        self._raw = self._raw[end + 2:]
        return True


def main():
    client = Client(int(sys.argv[1]))
    changes = [(SET_BAUDRATE, 19200), (SET_BAUDRATE, 57600), (SET_STOPSIZE, 2), (SET_CONTROL, XON_XOFF),
               (SET_BAUDRATE, 230400), (SET_CONTROL, NO_FLOW_CONTROL), (SET_STOPSIZE, 1), (SET_CONTROL, RTS_CTS),
               (SET_CONTROL, NO_FLOW_CONTROL), (SET_BAUDRATE, 1200)]
    for number, (command, value) in enumerate(changes):
        client.set(command, struct.pack(">I", value) if command == SET_BAUDRATE else bytes((value,)))
        client.ask(b"line %d of the client\r\n" % number * 20)
    client.close()


if __name__ == "__main__":
    try:
        main()
    except OSError as error:
        sys.exit(f"rfc2217_client.py: {error}")
