"""What is played while calls go wrong, and what must hold afterwards."""

import os
import re
import signal
import socket
import subprocess
import tempfile
import time

from peers import Broken, Device, Driver, SerialDevice, Stuck, Wrong, question, text_of
from places import FOR_EVER
from program import Program
from tapes import in_order, is_piece, tapes_in

READY = 10  # seconds: generous, nobody waits for them where all is well
END = 20
SMALL = [40, 300, 11, 900]
LARGE = [40, 9000, 11, 300]


def told_bytes(log):
    """How many bytes the log owns up to. Of a session's end and of a tape's end."""
    of_line = sum(int(n) for n in re.findall(r"(\d+) bytes reached nobody", log))
    of_tape = sum(int(n) for n in re.findall(
        r"(\d+) bytes and \d+ events are missing|(?<!bytes )(\d+) bytes passed and are on no tape|"
        r"in time; (\d+) bytes and the end", log) for n in n if n)
    return of_line, of_tape


def tells(log):
    return re.search(r" (warning|error) |^porttaped?: |a new pty takes its place", log, re.MULTILINE) is not None


class World:
    """One run of one scenario: a folder, the programs, and what was found wrong."""

    def __init__(self, config, trouble=None, addresses=()):
        self.config, self.trouble, self.addresses = config, trouble, addresses
        self.own = tempfile.TemporaryDirectory(prefix="porttape-trouble.", dir=os.environ.get("TMPDIR"))
        self.folder = os.path.realpath(self.own.name)
        os.mkdir(self.path("tapes"))
        self.findings, self.notes, self.programs, self.devices, self.count = [], [], [], [], 0
        self.memory = False

    def path(self, *parts):
        return os.path.join(self.folder, *parts)

    def number(self):
        self.count += 1
        return self.count

    def find(self, text):
        self.findings.append(text)

    def start(self, program, *arguments, trouble=True):
        with_trouble = trouble and self.trouble
        made = Program(self, [program, *arguments], self.trouble if with_trouble else None, self.addresses, self.memory)
        self.programs.append(made)
        return made

    def daemon(self, *arguments):
        return self.start(self.config.porttaped, *arguments)

    def keep(self, device):
        self.devices.append(device)
        return device

    def run(self, scenario):
        try:
            scenario(self)
            for program in self.programs:
                self.check_program(program)
        finally:
            for program in self.programs:
                program.close()
            for device in self.devices:
                if device.is_alive():
                    device.end()
        self.sites = [site for program in self.programs for site in program.sites]
        if self.findings and self.config.keep:
            kept = tempfile.mkdtemp(prefix="porttape-trouble-kept.")
            subprocess.run(["cp", "-a", self.folder + "/.", kept], check=False)
            self.notes.append(f"kept in {kept}")
        self.own.cleanup()

    @property
    def injected(self):
        return sum(site.troubled for site in self.sites)

    # What holds of every program however it was troubled.
    def check_program(self, program):
        log = program.log + program.out
        if program.status is None:
            self.find("the program is still there")
            return
        if program.status < 0 and not program.killed and not self.kills:
            self.find(f"ended by signal {signal.Signals(-program.status).name}: {log[-600:]}")
        for words in ("terminate called", "Assertion", "error of this program", "Sanitizer", "is not understood"):
            if words in log:
                self.find(f"'{words}': {log[-600:]}")
        wall = time.monotonic() - program.started
        if program.cpu_seconds > 0.7 + 0.25 * wall:
            self.find(f"it was busy for {program.cpu_seconds:.1f} s in {wall:.1f} s")
        if program.status > 0 and not log.strip() and not self.log_is_hit:
            self.find(f"status {program.status} without a word")

    @property
    def kills(self):
        return self.trouble is not None and self.trouble.action in ("kill", "kill-after", "torn")

    @property
    def log_is_hit(self):
        """Whether the trouble is the log's: then nothing can be asked of it."""
        return self.trouble is not None and ("daemon/log" in self.trouble.place or "daemon/main" in self.trouble.place)

    @property
    def for_ever(self):
        return self.trouble is not None and self.trouble.count == FOR_EVER

    @property
    def harmless(self):
        return self.trouble is None or self.trouble.harmless


class Line:
    """A daemon's line with a driver and a device, in sessions of questions and answers, and its invariants."""

    def __init__(self, world, daemon, device, open_driver, folder=None, sizes=LARGE, name="the line"):
        self.world, self.daemon, self.device, self.open_driver = world, daemon, device, open_driver
        self.folder, self.sizes, self.name = folder, sizes, name
        self.driver = Driver(patience=1.5 if device.datagrams else 6)
        self.broken, self.done, self.sessions = [], 0, 0

    @staticmethod
    def answers(sizes):
        """What a device gives to a line: the answer, where that is a whole question."""
        def answer(line):
            name = re.match(rb"Q(\d+)\.(\d+)\.0 ", line)
            if not name:
                return b""
            session, number = int(name[1]), int(name[2])
            size = sizes[number % len(sizes)]
            return text_of(b"A", session, number, 2 * size) if line == question(session, number, size) else b""
        return answer

    def begin(self):
        self.sessions += 1
        self.asked = 0
        self.whole = True
        try:
            self.open_driver(self.driver)
        except Broken as error:
            self.fail(error)

    def ask(self, count):
        for _ in range(count):
            if not self.whole:
                return
            size = self.sizes[self.asked % len(self.sizes)]
            try:
                self.driver.ask(question(self.sessions, self.asked, size),
                                text_of(b"A", self.sessions, self.asked, 2 * size))
            except (Broken, Stuck, Wrong) as error:
                self.fail(error)
            self.asked += 1

    def fail(self, error):
        self.whole = False
        self.broken.append(f"session {self.sessions}: {type(error).__name__}: {error}")
        if isinstance(error, Wrong) and not self.world.trouble:
            self.world.find(str(error))

    def close(self):
        self.driver.close()

    def session(self, count):
        self.begin()
        self.ask(count)
        self.close()
        return self.whole

    def heal(self):
        """What went wrong once is over: after some tries a session is whole again."""
        if not self.broken or self.world.for_ever or self.daemon.wait(0):
            return
        end = time.monotonic() + 8
        while time.monotonic() < end:
            if self.session(3):
                return
            if self.daemon.wait(0.05):
                return
        self.world.find(f"{self.name} does not come back: {self.broken[-1]}; {self.daemon.log[-600:]}")

    def stop(self):
        """SIGTERM, and the end within its bounds."""
        self.daemon.signal(signal.SIGTERM)
        if not self.daemon.wait(END):
            self.world.find(f"SIGTERM does not end it within {END} s: {self.daemon.log[-600:]}")
            self.daemon.kill()
        if self.device.is_alive():
            self.device.end()

    def find(self, text):
        self.world.find(f"{self.name}: {text}" if self.name != "the line" else text)

    def check(self):
        world, log = self.world, self.daemon.log
        killed = self.daemon.killed or world.kills
        of_line, of_tape = told_bytes(log)
        told = tells(log) or self.daemon.status != 0 or world.log_is_hit
        if world.harmless and not killed:
            if self.broken:
                self.find(f"nothing was wrong, but {self.broken}: {log[-600:]}")
            if self.daemon.status != 0:
                self.find(f"nothing was wrong, but status {self.daemon.status}: {log[-600:]}")
        if self.broken and not told and not killed:
            self.find(f"nothing is told of {self.broken}; log: {log[-300:]}")
        self.check_line(killed, told, of_line)
        if self.folder and os.path.isdir(self.folder):
            self.check_tapes(killed, of_line, of_tape)

    def check_line(self, killed, told, of_line):
        sent, got = self.driver.sent, self.driver.got
        unhurt = not self.broken and not killed
        slack = of_line if unhurt else len(sent) + len(self.device.sent)
        if not is_piece(self.device.got, sent, slack):
            self.find(f"the device got {len(self.device.got)} of {len(sent)} bytes, {of_line} told: "
                      f"{difference(self.device.got, sent)}")
        if not is_piece(got, self.device.sent, slack):
            self.find(f"the driver got {len(got)} of {len(self.device.sent)} bytes, {of_line} told: "
                      f"{difference(got, self.device.sent)}")

    def check_tapes(self, killed, of_line, of_tape):
        world, status = self.world, self.daemon.status
        tapes = tapes_in(self.folder)
        write = [block for tape in tapes for block in tape.write]
        read = [block for tape in tapes for block in tape.read]
        for what, blocks, line in (("w", write, self.driver.sent), ("r", read, self.device.sent)):
            if wrong := in_order(blocks, line):
                self.find(f"{what} files: not what passed: {wrong}")
        on_tape = sum(len(data) for _, data in write), sum(len(data) for _, data in read)
        missing = max(0, len(self.device.got) - on_tape[0]) + max(0, len(self.driver.got) - on_tape[1])
        gaps = sum(tape.gap_bytes for tape in tapes)
        if missing > gaps + of_tape and not killed and not (self.world.log_is_hit):
            self.find(f"{missing} bytes are missing from the tapes, their gaps tell of {gaps}, the log of {of_tape}: "
                      f"{self.daemon.log[-600:]}")
        undelivered = on_tape[0] - len(self.device.got)
        if undelivered > gaps + of_line and not killed and not self.broken:
            self.find(f"{undelivered} bytes on the tape did not reach the device, {gaps} told")
        if status == 0 and not killed and (missing or not all(tape.ended for tape in tapes)):
            self.find(f"status 0, but {missing} bytes are missing, or a tape has no end")
        if world.harmless and not killed and (missing or any(tape.has_gap for tape in tapes)):
            self.find(f"nothing was wrong, but the tape has a gap ({missing} missing): {self.daemon.log[-300:]}")
        for tape in tapes:
            self.check_tape(tape, killed)
        strange = [name for name in os.listdir(self.folder) if not re.fullmatch(r"t(\.\d+)?\.log[rwe]", name)]
        if strange and not killed and world.trouble and not world.trouble.kind.startswith(("unlink", "rename")):
            self.find(f"left in the tapes' folder: {strange}")

    def check_tape(self, tape, killed):
        name = os.path.basename(tape.base)
        if tape.damage:
            self.find(tape.damage)
        if back := tape.steps_back():
            self.find(back)
        if tape.torn_bytes and not killed and not self.world.for_ever:
            self.find(f"{name}: {tape.torn_bytes} torn bytes")
        code, sound, words = tape.sound(self.world.config.porttape)
        if code not in (0, 1, 2):
            self.find(f"verify ended with {code}: {words}")
        if code == 1 or sound and (not tape.ended or tape.has_gap or tape.torn_bytes):
            self.find(f"verify says {words!r} of a tape with end {tape.ended}, gap {tape.has_gap}, torn {tape.torn_bytes}")


def difference(part, whole):
    size = len(os.path.commonprefix([part, whole]))
    return f"at {size}: {part[size:size + 30]!r} for {whole[size:size + 30]!r}"


def left_behind(world, *names):
    """Links and files that no program may leave, unless it was killed or could not remove them."""
    for name in names:
        excused = any(program.killed for program in world.programs) or world.kills or world.trouble and (
            world.trouble.kind in ("unlink", "readlink", "lstat", "stat"))
        if os.path.lexists(world.path(name)) and not excused:
            world.find(f"{name} is left behind")


def check_start(world, daemon, links):
    """Ready, or ended with a status and a word about it."""
    if daemon.wait_ready(links, READY):
        return True
    if not daemon.wait(0):
        if not tells(daemon.log) and not world.log_is_hit:
            world.find(f"it does not get ready within {READY} s, and says nothing: {daemon.log[-300:]}")
        return False
    if daemon.status == 0 and not world.kills:
        world.find(f"it ended with status 0 before it was ready: {daemon.log[-300:]}")
    return False


def recorded(world, line, links):
    """Two sessions, and a next tape in the second."""
    if check_start(world, line.daemon, links):
        line.session(4)
        line.begin()
        line.ask(2)
        line.daemon.signal(signal.SIGUSR1)
        line.ask(2)
        line.close()
        line.heal()
    line.stop()
    line.check()
    left_behind(world, *[os.path.basename(link) for link in links], "pid")


def record(world):
    """Records a serial device under a pty: two sessions, a next tape, a pidfile, a log file."""
    device = world.keep(SerialDevice(Line.answers(LARGE)))
    port = world.path("port")
    daemon = world.daemon("record", "--device", f"serial:{device.path},baud=115200", "--driver", f"pty:{port}",
                          "--tape", world.path("tapes/t"), "--pidfile", world.path("pid"))
    recorded(world, Line(world, daemon, device, lambda driver: driver.open_path(port), world.path("tapes")), [port])


def listen(family, address, kind=socket.SOCK_STREAM):
    made = socket.socket(family, kind)
    made.bind(address)
    if kind == socket.SOCK_STREAM:
        made.listen(5)
    return made


def free_port(kind=socket.SOCK_STREAM):
    with listen(socket.AF_INET, ("127.0.0.1", 0), kind) as probe:
        return probe.getsockname()[1]


def wait_bound(daemon, path, port):
    """Until somebody listens there: the daemon says that it is ready, or ends."""
    end = time.monotonic() + READY
    while time.monotonic() < end and not daemon.wait(0.01):
        with open(path, encoding="ascii") as file:
            if re.search(rf":{port:04X} 00000000:0000 (0A|07)", file.read()):
                return True
    return False


def socket_recorded(world, line, there):
    if there:
        line.session(4)
        line.session(4)
        line.heal()
    elif not line.daemon.wait(0) and not tells(line.daemon.log):
        world.find(f"it does not get ready, and says nothing: {line.daemon.log[-300:]}")
    line.stop()
    line.check()


def record_tcp(world):
    """Records a TCP device under a listening TCP port."""
    server = listen(socket.AF_INET, ("127.0.0.1", 0))
    device = world.keep(Device(Line.answers(LARGE), listener=server))
    port = free_port()
    daemon = world.daemon("record", "--device", f"tcp:localhost:{server.getsockname()[1]}", "--driver",
                          f"tcp-listen:127.0.0.1:{port}", "--tape", world.path("tapes/t"))
    line = Line(world, daemon, device, lambda driver: driver.connect(socket.AF_INET, ("127.0.0.1", port)),
                world.path("tapes"))
    socket_recorded(world, line, wait_bound(daemon, "/proc/net/tcp", port))


def record_unix(world):
    """Records a Unix socket under another one."""
    server = listen(socket.AF_UNIX, world.path("device"))
    device = world.keep(Device(Line.answers(LARGE), listener=server))
    port = world.path("port")
    daemon = world.daemon("record", "--device", f"unix:{world.path('device')}", "--driver", f"unix-listen:{port}",
                          "--tape", world.path("tapes/t"))
    line = Line(world, daemon, device, lambda driver: driver.connect(socket.AF_UNIX, port), world.path("tapes"))
    socket_recorded(world, line, daemon.wait_ready([port], READY))
    left_behind(world, "port")


def record_udp(world):
    """Records a UDP device under a UDP port."""
    server = listen(socket.AF_INET, ("127.0.0.1", 0), socket.SOCK_DGRAM)
    device = world.keep(Device(Line.answers(SMALL), listener=server, datagrams=True))
    port = free_port(socket.SOCK_DGRAM)
    daemon = world.daemon("record", "--device", f"udp:127.0.0.1:{server.getsockname()[1]}", "--driver",
                          f"udp-listen:127.0.0.1:{port}", "--tape", world.path("tapes/t"))
    line = Line(world, daemon, device,
                lambda driver: driver.connect(socket.AF_INET, ("127.0.0.1", port), socket.SOCK_DGRAM),
                world.path("tapes"), SMALL)
    there = wait_bound(daemon, "/proc/net/udp", port)
    if there:
        line.session(6)
        line.heal()
    line.stop()
    line.check()


SCENARIOS = {function.__name__: function for function in (record, record_tcp, record_unix, record_udp)}


def program_of(_name, config):
    """The program that a scenario troubles."""
    return config.porttaped
