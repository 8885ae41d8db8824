"""A satellite receiver: NMEA 0183 or u-blox's binary UBX, five fixes a second, always at the same place. It is silent at
first, so that a driver that tries one thing after another while nothing comes tries the same things each time.

It speaks at its own rate until it is told another: by UBX-CFG-PRT, or by $PUBX,41, and answers that at the old rate.
"""

import struct
import time

from far.quiet import Quiet

SILENT_SECONDS = 4
FIX_SECONDS = 0.2
DRIP_SECONDS = 0.001
PREAMBLE_SECONDS = 7
LATITUDE, LONGITUDE, ALTITUDE = 54.1801, 7.8895, 4.2


def nmea(body):
    check = 0
    for byte in body.encode():
        check ^= byte
    return f"${body}*{check:02X}\r\n".encode()


def ubx(kind, identity, payload=b""):
    body = struct.pack("<BBH", kind, identity, len(payload)) + payload
    a = b = 0
    for byte in body:
        a = (a + byte) & 0xFF
        b = (b + a) & 0xFF
    return b"\xb5\x62" + body + bytes((a, b))


def degrees(value, width, hemispheres):
    whole = int(abs(value))
    return f"{whole:0{width}d}{(abs(value) - whole) * 60:07.4f},{hemispheres[value < 0]}"


class Gps(Quiet):
    """`drips`: it begins with a byte each millisecond by which a rate can be found, as long as the line has another, and
    PREAMBLE_SECONDS longer: on a tape there must be some to spare for a driver that counts its reads, yet fewer than
    it gives a rate.
    """

    def __init__(self, rate, binary=False, drips=False):
        super().__init__(rate)
        self._binary = binary
        self._drips_until = 0 if drips else None
        self._line = bytearray()
        self._next = None
        self._fixes = 0

    def opened(self, line):
        self._next = time.monotonic() + SILENT_SECONDS

    def closed(self):
        self._next = None

    def due(self):
        return self._next

    def tick(self, line):
        if self._drips_until is not None:
            self._drip(line)
            return
        self._next += FIX_SECONDS
        self._fixes += 1
        line.send(self._navigation() if self._binary else self._sentences())

    def _drip(self, line):
        now = time.monotonic()
        if not line.understood():
            self._drips_until = now + PREAMBLE_SECONDS
        elif now > self._drips_until:
            self._drips_until = None
        self._next = now + DRIP_SECONDS
        line.send(b"U")

    def received(self, line, data):
        self._line += data
        while self._take_one(line):
            pass

    def _sentences(self):
        seconds = 12 * 3600 + self._fixes * FIX_SECONDS
        clock = f"{int(seconds) // 3600:02d}{int(seconds) // 60 % 60:02d}{seconds % 60:05.2f}"
        place = degrees(LATITUDE, 2, "NS") + "," + degrees(LONGITUDE, 3, "EW")
        return (nmea(f"GPGGA,{clock},{place},1,08,0.9,{ALTITUDE},M,45.1,M,,")
                + nmea("GPGSA,A,3,02,05,07,13,15,20,25,29,,,,,1.7,0.9,1.4")
                + nmea(f"GPRMC,{clock},A,{place},6.0,75.0,010226,,,A"))

    def _navigation(self):
        """UBX-NAV-PVT, 92 bytes: 1 February 2026, a three-dimensional fix."""
        milliseconds = 43200000 + int(self._fixes * FIX_SECONDS * 1000)
        second, rest = divmod(milliseconds - 43200000, 1000)
        return ubx(0x01, 0x07, struct.pack(
            "<IHBBBBBBIiBBBBiiiiIIiiiiiIIHHIiI",
            milliseconds, 2026, 2, 1, 12, second // 60 % 60, second % 60, 0x07, 20, rest * 1000000, 3, 0x01, 0, 8,
            round(LONGITUDE * 1e7), round(LATITUDE * 1e7), round((ALTITUDE + 45.1) * 1000), round(ALTITUDE * 1000),
            2500, 3000, 0, 0, 0, 0, 0, 500, 100000, 170, 0, 0, 0, 0))

    def _take_one(self, line):
        """Takes one message off what was received; whether there may be another."""
        starts = [at for at in (self._line.find(b"\xb5\x62"), self._line.find(b"$")) if at >= 0]
        if not starts:
            self._line.clear()
            return False
        del self._line[:min(starts)]
        return self._take_sentence(line) if self._line[:1] == b"$" else self._take_ubx(line)

    def _take_sentence(self, line):
        end = self._line.find(b"\n")
        if end < 0:
            return False
        fields = bytes(self._line[:end]).split(b"*")[0].decode("ascii", "replace").split(",")
        del self._line[:end + 1]
        if fields[:2] == ["$PUBX", "41"]:
            self._switch(int(fields[5]))
        return True

    def _take_ubx(self, line):
        if len(self._line) < 8:
            return False
        kind, identity, length = struct.unpack_from("<BBH", self._line, 2)
        if len(self._line) < length + 8:
            return False
        message = bytes(self._line[:length + 8])
        payload = message[6:-2]
        if ubx(kind, identity, payload) != message:
            del self._line[:2]
            return True
        del self._line[:length + 8]
        self._answer(line, kind, identity, payload)
        return True

    def _answer(self, line, kind, identity, payload):
        if (kind, identity) == (0x0A, 0x04):
            line.send(ubx(0x0A, 0x04, b"2.01 (75350)".ljust(30, b"\0") + b"00080000".ljust(10, b"\0")
                          + b"PROTVER 15.00".ljust(30, b"\0")))
        elif (kind, identity) == (0x06, 0x00) and len(payload) <= 1:
            line.send(ubx(0x06, 0x00, self._port()))
            line.send(ubx(0x05, 0x01, bytes((kind, identity))))
        elif kind == 0x06:
            line.send(ubx(0x05, 0x01, bytes((kind, identity))))
            if identity == 0x00 and len(payload) == 20:
                self._switch(struct.unpack_from("<I", payload, 8)[0])

    def _port(self):
        return struct.pack("<BBHIIHHHH", 1, 0, 0, 0x000008D0, self.rate, 3, 3, 0, 0)

    def _switch(self, rate):
        self.rate = rate
