"""Two uninterruptible power supplies with steady readings: one speaks Megatec's Q1 protocol, one APC's Smart protocol."""

from far.quiet import Quiet


class Megatec(Quiet):
    """Commands end with CR; one it does not know is echoed."""

    ANSWERS = {
        "Q1": "(231.2 231.2 230.9 018 50.0 27.4 25.0 00001000",
        "F": "#230.0 003 24.00 50.0",
        "I": "#PORTTAPE        FAR-END    V1.01     ",
    }

    def __init__(self, rate=2400):
        super().__init__(rate)
        self._heard = b""
        self.polls = 0

    def received(self, line, data):
        *commands, self._heard = (self._heard + data).split(b"\r")
        for command in commands:
            text = command.decode("latin-1").strip()
            self.polls += text == "Q1"
            line.send((self.ANSWERS.get(text, text) + "\r").encode("latin-1"))


class ApcSmart(Quiet):
    """Each command is one character; answers end with CR LF. It is in smart mode once it has heard Y."""

    ANSWERS = {
        "Y": "SM", "\x01": "SMART-UPS 700", "b": "FWD", "V": "50.9.I", "Q": "08", "L": "231.1", "M": "232.2",
        "N": "229.5", "O": "230.4", "F": "50.00", "P": "018.2", "B": "27.40", "C": "031.5", "f": "100.0", "j": "0042:",
        "n": "AS0012345678", "m": "01/02/03", "x": "01/02/03", "c": "FAR_END", "G": "S", "X": "OK", "9": "FF",
        "g": "024", ">": "000", "e": "00", "h": "NA", "o": "230", "u": "264", "l": "208", "q": "02", "p": "020",
        "r": "000", "s": "H", "k": "0", "E": "336",
    }
    CAPABILITIES = "3.!$%+?=#|.\\=" + "".join(sorted(key for key in ANSWERS if key.isprintable()))

    def __init__(self, rate=2400):
        super().__init__(rate)
        self._smart = False
        self.polls = 0

    def received(self, line, data):
        for command in data.decode("latin-1"):
            self._smart = self._smart or command == "Y"
            if not self._smart or command in "\r\n\x1b":
                continue
            self.polls += command == "Q"
            answer = self.CAPABILITIES if command == "a" else self.ANSWERS.get(command, "NA")
            line.send((answer + "\r\n").encode("latin-1"))
