"""SCIP 2.0, the protocol of many laser scanners: checksums, number encoding, and taking an answer apart."""

END = b"\n\n"


def checksum(text):
    return bytes([(sum(text) & 0x3F) + 0x30])


def encode(value, width):
    return bytes(((value >> 6 * place) & 0x3F) + 0x30 for place in reversed(range(width)))


def decode(text):
    value = 0
    for char in text:
        value = value << 6 | (char - 0x30)
    return value


def answer(echo, status, lines=()):
    """An answer of text lines; each gets `;` and its checksum."""
    head = [echo, status + checksum(status)]
    return b"\n".join(head + [line + b";" + checksum(line) for line in lines]) + END


def data_answer(echo, status, stamp, payload):
    """An answer with measurements: a 24-bit time stamp, then 64-character blocks, each with its checksum."""
    time_stamp = encode(stamp & 0xFFFFFF, 4)
    blocks = [payload[at:at + 64] for at in range(0, len(payload), 64)]
    lines = [echo, status + checksum(status), time_stamp + checksum(time_stamp)]
    return b"\n".join(lines + [block + checksum(block) for block in blocks]) + END


class Answer:
    """A checked answer: echo, status, and either text fields or a time stamp with data. ValueError when a checksum is wrong."""

    def __init__(self, raw):
        lines = raw[:-len(END)].split(b"\n")
        if len(lines) < 2:
            raise ValueError(f"answer too short: {raw!r}")
        self.echo = lines[0]
        self.status = self._checked(lines[1])
        self.fields, self.stamp, self.data = {}, None, b""
        rest = lines[2:]
        if self.echo[:2] in (b"GD", b"GS", b"MD", b"MS") and rest:
            self.stamp = decode(self._checked(rest[0]))
            self.data = b"".join(self._checked(line) for line in rest[1:])
            return
        for line in rest:
            text = line[:-2]
            if line[-2:-1] != b";" or checksum(text) != line[-1:]:
                raise ValueError(f"bad checksum in {line!r}")
            name, _, value = text.decode("ascii").partition(":")
            self.fields[name] = value

    @staticmethod
    def _checked(line):
        if len(line) < 2 or checksum(line[:-1]) != line[-1:]:
            raise ValueError(f"bad checksum in {line!r}")
        return line[:-1]

    def ranges(self, width):
        return [decode(self.data[at:at + width]) for at in range(0, len(self.data), width)]
