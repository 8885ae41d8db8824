"""A mobile phone's modem at one rate: enough AT commands (3GPP 27.007, 27.005) to tell who it is and to send a message."""

from far.quiet import Quiet

ANSWERS = {
    "+CGMI": "PORTTAPE", "+CGMM": "FAR END 1", "+CGMR": "1.01", "+CGSN": "490154203237518",
    "+CIMI": "262011234567890", "+CSQ": "+CSQ: 18,0", "+CPIN?": "+CPIN: READY", "+CREG?": '+CREG: 0,1',
    "+CBC": "+CBC: 0,87", "+CSCS?": '+CSCS: "GSM"', "+CSCS=?": '+CSCS: ("GSM","IRA","UCS2")',
    "+CSCA?": '+CSCA: "+491710760000",145', "+CMGF=?": "+CMGF: (0,1)", "+CPMS=?": '+CPMS: ("SM"),("SM"),("SM")',
    "+CPMS?": '+CPMS: "SM",0,20,"SM",0,20,"SM",0,20', "+CNMI=?": "+CNMI: (0-2),(0-3),(0,2,3),(0-2),(0,1)",
    "+CPBS=?": '+CPBS: ("SM")', "+COPS?": '+COPS: 0,0,"Far End"', "+GMM": "FAR END 1", "+GMI": "PORTTAPE",
}
BARE = ("", "Z", "E0", "E1", "V1", "&F", "+CMEE=1", "+CMEE=0", "+CMEE=2", "+CMGF=0", "+CMGF=1", "+CFUN=1")


class Modem(Quiet):
    def __init__(self, rate=None):
        super().__init__(rate)
        self._heard = b""
        self._echo = True
        self._message = None
        self.sent = []  # the messages, as hexadecimal PDU

    def received(self, line, data):
        for byte in data:
            character = bytes((byte,))
            if self._echo:
                line.send(character)
            if self._message is not None:
                self._write_message(line, character)
            elif character == b"\r":
                command, self._heard = self._heard.decode("latin-1").strip(), b""
                if command[:2].upper() == "AT":
                    self._obey(line, command[2:])
            elif character != b"\x1b":
                self._heard += character

    def _obey(self, line, command):
        if command in ("E0", "E1"):
            self._echo = command == "E1"
        if command.startswith("+CMGS="):
            self._message = b""
            line.send(b"\r\n> ")
        elif command in ANSWERS:
            line.send(f"\r\n{ANSWERS[command]}\r\n\r\nOK\r\n".encode())
        elif command in BARE or command.startswith(("+CNMI=", "+CSCS=", "+CPMS=", "+CSMS=", "+CSCA=", "+CSMP=")):
            line.send(b"\r\nOK\r\n")
        else:
            line.send(b"\r\nERROR\r\n")

    def _write_message(self, line, character):
        if character == b"\x1a":
            self.sent.append(self._message.decode("latin-1"))
            self._message = None
            line.send(b"\r\n+CMGS: 7\r\n\r\nOK\r\n")
        else:
            self._message += character
