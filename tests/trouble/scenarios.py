"""What is played while calls go wrong, and what must hold afterwards."""

import dataclasses
import json
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable

from peers import Broken, Device, Driver, NoDevice, SerialDevice, Stuck, Wrong, question, text_of
from places import FOR_EVER, Trouble, nth, troubles_of
from program import Program
from tapes import in_order, is_piece, tapes_in

READY = 30  # seconds: generous, nobody waits for them where all is well
END = 60
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

    expected = {}  # what verbs print without trouble

    def __init__(self, config, trouble=None, addresses=(), memory=False):
        self.config, self.trouble, self.addresses, self.memory = config, trouble, addresses, memory
        self.tapes = None  # the folder whose tapes are meant by "tape"
        self.own = tempfile.TemporaryDirectory(prefix="porttape-trouble.", dir=os.environ.get("TMPDIR"))
        self.folder = os.path.realpath(self.own.name)
        os.mkdir(self.path("tapes"))
        self.findings, self.late, self.notes, self.programs, self.devices, self.count = [], [], [], [], [], 0

    def path(self, *parts):
        return os.path.join(self.folder, *parts)

    def number(self):
        self.count += 1
        return self.count

    def find(self, text):
        self.findings.append(text)

    def find_late(self, text):
        """A finding whose only fault is time: see tests/README.md."""
        self.late.append(text)

    @property
    def only_late(self):
        return bool(self.late) and not self.findings

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
        if (self.findings or self.late) and self.config.keep:
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
    def shared_is_hit(self):
        """Whether the trouble is of what all channels have in common."""
        return self.trouble is not None and (self.log_is_hit or any(
            words in self.trouble.place for words in ("epoll", "signal_set", "eventfd", "file_events", "workers", "logger")))

    @staticmethod
    def injected_so_far(program):
        return any(site.troubled for site in program.sites)

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
        # Where nothing goes wrong nobody waits so long; where a datagram may be lost its answer is not waited for.
        self.driver = Driver(patience=30 if world.harmless else 10)
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
            if self.driver.is_tty and not self.daemon.has_master_of(self.driver.fd):
                self.driver.close()  # the link of one that was killed: another's device may have the number now
                raise Broken("the program that made the port has gone")
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
        end = time.monotonic() + END
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
            self.world.find_late(f"SIGTERM does not end it within {END} s: {self.daemon.log[-600:]}")
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
        if os.path.lexists(world.path(name)):
            find_left(world, name)


def find_left(world, name):
    excused = any(program.killed for program in world.programs) or world.kills or world.trouble and (
        world.trouble.kind in ("unlink", "unlinkat", "readlink", "lstat", "stat") or
        world.trouble.kind.startswith("flock") and "EAGAIN" in str(world.trouble) or  # another program's then
        "net/unix_port" in world.trouble.place)  # a socket file that cannot be looked at is nobody's
    if not excused:
        world.find(f"{name} is left behind")


def left_locks(world, pid):
    """Lock files of that process, which are not in the world's own folder: taken away, and told where one should not be there."""
    folder = "/var/lock"
    names = [name for name in os.listdir(folder) if name.startswith(("LCK..", "LTMP."))] if os.path.isdir(folder) else []
    for name in names:
        try:
            with open(os.path.join(folder, name), encoding="ascii") as file:
                own = file.read(32).strip() == str(pid) or name.startswith(f"LTMP.{pid}.")
        except (OSError, ValueError):  # another's
            continue
        if own:
            os.unlink(os.path.join(folder, name))
            find_left(world, name)


def there(*links):
    return lambda: all(os.path.lexists(link) for link in links)


def listens(table, words):
    """Whether a table of /proc/net has such a line."""
    def look():
        with open(table, encoding="ascii", errors="replace") as file:
            return re.search(words, file.read(), re.MULTILINE) is not None
    return look


def has_socket(daemon, table, words):
    """Whether a table of /proc/net has such a line, of a socket that the daemon has: until it execs, a program that another
    thread starts has whatever this one has open."""
    def look():
        folder = f"/proc/{daemon.pid}/fd"
        try:
            own = {os.readlink(os.path.join(folder, fd)) for fd in os.listdir(folder)}
        except OSError:
            return False  # it has ended, or has closed one meanwhile
        with open(table, encoding="ascii", errors="replace") as file:
            return any(f"socket:[{line.split()[9]}]" in own for line in file if re.search(words, line))
    return look


def check_start(world, daemon, is_there):
    """Ready, or ended with a status and a word about it."""
    if daemon.wait_ready(is_there, READY):
        return True
    if not daemon.wait(0):
        if not tells(daemon.log) and not world.log_is_hit:
            world.find_late(f"it does not get ready within {READY} s, and says nothing: {daemon.log[-300:]}")
    elif daemon.status == 0 and not world.kills:
        world.find(f"it ended with status 0 before it was ready: {daemon.log[-300:]}")
    return False


def start_recording(world, name="tapes/t", *options, locks=""):
    """A recording of a serial device under a pty."""
    device = world.keep(SerialDevice(Line.answers(LARGE)))
    port = world.path("port")
    daemon = world.daemon("record", "--device", f"serial:{device.path},baud=115200{locks}", "--driver",
                          f"pty:{port}", "--tape", world.path(name), "--pidfile", world.path("pid"), *options)
    return Line(world, daemon, device, lambda driver: driver.open_path(port), world.path("tapes")), port


def play_recording(world, line, port):
    """Two sessions, and a next tape in the second."""
    if check_start(world, line.daemon, there(port)):
        line.session(4)
        line.begin()
        line.ask(2)
        line.daemon.signal(signal.SIGUSR1)
        line.ask(2)
        line.close()
        line.heal()
    line.stop()


def record(world):
    """Records a serial device under a pty: two sessions, a next tape, a pidfile."""
    line, port = start_recording(world, locks=",uucplock")
    play_recording(world, line, port)
    line.check()
    left_behind(world, "port", "pid")
    left_locks(world, line.daemon.pid)


def listen(family, address, kind=socket.SOCK_STREAM):
    made = socket.socket(family, kind)
    made.bind(address)
    if kind == socket.SOCK_STREAM:
        made.listen(5)
    return made


def free_port(kind=socket.SOCK_STREAM):
    """One that nobody has now."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def play_sessions(world, line, is_there):
    if check_start(world, line.daemon, is_there):
        line.session(4)
        line.session(4)
        line.heal()
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
    play_sessions(world, line, has_socket(daemon, "/proc/net/tcp", rf":{port:04X} 00000000:0000 0A"))


def record_unix(world):
    """Records a Unix socket under another one."""
    server = listen(socket.AF_UNIX, world.path("device"))
    device = world.keep(Device(Line.answers(LARGE), listener=server))
    port = world.path("port")
    daemon = world.daemon("record", "--device", f"unix:{world.path('device')}", "--driver", f"unix-listen:{port}",
                          "--tape", world.path("tapes/t"))
    line = Line(world, daemon, device, lambda driver: driver.connect(socket.AF_UNIX, port), world.path("tapes"))
    play_sessions(world, line, listens("/proc/net/unix", rf" 00010000 .* {port}$"))
    left_behind(world, "port")


def record_udp(world):
    """Records a UDP device under a UDP port."""
    server = listen(socket.AF_INET, ("127.0.0.1", 0), socket.SOCK_DGRAM)
    device = world.keep(Device(Line.answers(SMALL), listener=server, datagrams=True))
    port = free_port(socket.SOCK_DGRAM)
    reply = free_port(socket.SOCK_DGRAM)
    daemon = world.daemon("record", "--device", f"udp:127.0.0.1:{server.getsockname()[1]},recv_port={reply}", "--driver",
                          f"udp-listen:127.0.0.1:{port}", "--tape", world.path("tapes/t"))
    line = Line(world, daemon, device,
                lambda driver: driver.connect(socket.AF_INET, ("127.0.0.1", port), socket.SOCK_DGRAM),
                world.path("tapes"), SMALL)
    if check_start(world, daemon, has_socket(daemon, "/proc/net/udp", rf":{port:04X} 00000000:0000 07")):
        line.session(6)
        line.heal()
    line.stop()
    line.check()


def make_tape(base, sizes):
    """The tape of one session, as an older recorder would leave it: no events."""
    with open(base + "r", "wb") as read, open(base + "w", "wb") as write:
        at = 1000
        for number, size in enumerate(sizes):
            for file, text in ((write, question(1, number, size)), (read, text_of(b"A", 1, number, 2 * size))):
                for i in range(0, len(text), 4096):
                    part = text[i:i + 4096]
                    file.write(struct.pack(">III", 0, at, len(part)) + part)
                    at += 500


def replay(world):
    """Replays a tape under a pty, once, with a report."""
    make_tape(world.path("tapes/t.log"), LARGE)
    port, report = world.path("port"), world.path("report")
    daemon = world.daemon("replay", "--tape", world.path("tapes/t"), "--driver", f"pty:{port}", "--report", report, "--once")
    line = Line(world, daemon, NoDevice(), lambda driver: driver.open_path(port))
    if check_start(world, daemon, there(port)):
        line.session(len(LARGE))
        line.daemon.wait(END if world.harmless else 5)
    line.stop()
    verdict = None
    if os.path.exists(report):
        with open(report, encoding="utf-8") as file:
            verdict = json.load(file)["verdict"]  # one that cannot be read is a finding
    if line.broken and (daemon.status == 0 or verdict == "pass"):
        world.find(f"status {daemon.status}, verdict {verdict}, but {line.broken}")
    if world.harmless and (line.broken or daemon.status != 0 or verdict != "pass"):
        world.find(f"nothing was wrong, but status {daemon.status}, verdict {verdict}, {line.broken}: {daemon.log[-400:]}")
    if line.broken and daemon.status > 2 and not tells(daemon.log):
        world.find(f"status {daemon.status}, and nothing is told of {line.broken}: {daemon.log[-400:]}")
    left_behind(world, "port")


ASKER = """
import os, sys, tty
fd = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
tty.setraw(fd)
asked, answers = open(sys.argv[2], "rb").read(), open(sys.argv[3], "rb").read()
for number, question in enumerate(asked.splitlines(True)):
    os.write(fd, question)
    answer = answers.splitlines(True)[number]
    while answer:
        data = os.read(fd, len(answer))
        if not data or not answer.startswith(data):
            sys.exit(7)
        answer = answer[len(data):]
"""


def start_asker(world, verb, *options):
    """A verb of porttape that runs a command, which asks and wants its answers; ended."""
    with open(world.path("asked"), "wb") as asked, open(world.path("answers"), "wb") as answers:
        for number, size in enumerate(SMALL):
            asked.write(question(1, number, size))
            answers.write(text_of(b"A", 1, number, 2 * size))
    program = world.start(world.config.porttape, verb, "--tape", world.path("tapes/t"), *options, "--", sys.executable, "-S",
                          "-E", "-c", ASKER, "{port}", world.path("asked"), world.path("answers"))
    if not program.wait(END):
        world.find_late(f"it does not end within {END} s: {program.log[-400:]}")
        program.kill()
    elif world.harmless and program.status != 0:
        world.find(f"nothing was wrong, but status {program.status}: {(program.out + program.log)[-400:]}")
    return program


def record_command(world):
    """`porttape record`: a command on a device, with a tape."""
    device = world.keep(SerialDevice(Line.answers(SMALL)))
    program = start_asker(world, "record", "--device", f"serial:{device.path}")
    device.end()
    if program.status == 0 and not world.kills:
        tapes = tapes_in(world.path("tapes"))
        whole = [sum(SMALL), 2 * sum(SMALL)]
        found = [sum(len(data) for tape in tapes for _, data in blocks(tape))
                 for blocks in (lambda tape: tape.write, lambda tape: tape.read)]
        if found != whole or not all(tape.ended and not tape.has_gap for tape in tapes):
            world.find(f"status 0, but the tape has {found} of {whole} bytes, or a gap, or no end: {program.log[-400:]}")
    check_private_folder(world)


def test(world):
    """`porttape test`: a command against a tape."""
    make_tape(world.path("tapes/t.log"), SMALL)
    program = start_asker(world, "test", "--timeout", "8", "--report", world.path("report"))
    if program.status == 0 and "pass" not in program.out + program.log and "write.file" not in str(world.trouble):
        world.find(f"status 0 without a verdict: {program.out}")
    check_private_folder(world)


def check_private_folder(world):
    if strange := [name for name in os.listdir(world.folder) if name.startswith("porttape-")]:
        if not world.trouble or not world.trouble.kind.startswith(("unlink", "rmdir", "readlink", "lstat", "stat")):
            world.find(f"{strange} is left behind")


def tools(verb):
    """A verb that reads a sound tape: it says so only if it could read it."""
    def scenario(world):
        tape = os.path.join(world.config.source, "sample-logs/modbus_rtu.log")
        program = world.start(world.config.porttape, verb, *(["--json"] if verb != "verify" else []), tape)
        if not program.wait(END):
            program.kill()
            return world.find_late(f"it does not end within {END} s")
        if world.harmless and program.status != 0:
            world.find(f"nothing was wrong, but status {program.status}: {program.log}")
        if world.injected_so_far(program) and not world.harmless and program.status == 0 and world.trouble.kind in (
                "pread.file", "read.file", "open", "write.file") and world.expected.get(verb) != program.out:
            world.find(f"status 0, and another output than without trouble: {program.out[-200:]}")
        if not world.trouble:
            world.expected[verb] = program.out
        return None
    scenario.__doc__ = f"`porttape {verb}` of a tape."
    return scenario


def channels(world):
    """Two recordings in one process. What happens to the one is nothing to the other."""
    lines, config = [], ""
    for name in ("one", "two"):
        os.mkdir(world.path(name))
        device = world.keep(SerialDevice(Line.answers(LARGE)))
        port = world.path(f"port.{name}")
        config += f"[channel {name}]\ndevice=serial:{device.path}\ndriver=pty:{port}\ntape={world.path(name, 't')}\n"
        lines.append(Line(world, None, device, lambda driver, port=port: driver.open_path(port), world.path(name), name=name))
    with open(world.path("config"), "w", encoding="utf-8") as file:
        file.write(config)
    ports = [world.path("port.one"), world.path("port.two")]
    world.tapes = world.path("one/")
    daemon = world.daemon("run", world.path("config"))
    for line in lines:
        line.daemon = daemon
    check_start(world, daemon, lambda: daemon.said_ready or all(os.path.lexists(port) for port in ports))
    if not daemon.wait(0):
        for line in lines:
            line.begin()
        for _ in range(4):
            for line in lines:
                line.ask(1)
        for line in lines:
            line.close()
            line.session(3)
        for line in lines:
            line.heal()
    for line in lines:
        line.stop()
    for line in lines:
        line.check()
    aimed = world.trouble and world.trouble.kind.endswith((".tape", ".tapes"))
    hurt = [line.name for line in lines if line.broken]
    if aimed and "two" in hurt or len(hurt) > 1 and not world.for_ever and not world.shared_is_hit:
        world.find(f"trouble of one channel, and {hurt} are hurt: {[line.broken for line in lines]}; {daemon.log[-600:]}")
    left_behind(world, "port.one", "port.two")


def crash(world):
    """A recording is killed at a write; what is left can be used, and the next recording begins where it was."""
    line, port = start_recording(world)
    play_recording(world, line, port)
    line.check()
    for tape in tapes_in(world.path("tapes")):
        if os.path.exists(tape.base + "r") or os.path.exists(tape.base + "w"):
            check_leftover(world, tape)
    line.device.end() if line.device.is_alive() else None
    if not line.daemon.status < 0:
        return
    world.killed_before = True
    device = world.keep(SerialDevice(Line.answers(LARGE)))
    daemon = world.start(world.config.porttaped, "record", "--device", f"serial:{device.path}", "--driver", f"pty:{port}",
                         "--tape", world.path("tapes/t"), "--on-existing", "next", "--pidfile", world.path("pid"),
                         trouble=False)
    again = Line(world, daemon, device, line.open_driver, name="the next recording")
    if not daemon.wait_ready(lambda: os.path.lexists(port) and f"{port} is there" in daemon.log, READY):
        # Killed within the kernel's clock tick in which it made the link: another program's pty may look older.
        if world.trouble.kind != "rename":
            world.find(f"the next recording does not begin: {daemon.log[-400:]}")
    elif not again.session(3):
        world.find(f"the next recording: {again.broken}")
    again.stop()
    if daemon.status != 0:
        world.find(f"the next recording ended with {daemon.status}: {daemon.log[-400:]}")


def check_leftover(world, tape):
    """What a killed recording left: the tools end in order, and find each whole block."""
    porttape = world.config.porttape
    info = subprocess.run([porttape, "info", "--json", tape.base], capture_output=True, text=True, check=False)
    cat = subprocess.run([porttape, "cat", "--blocks", "--json", tape.base], capture_output=True, text=True, check=False)
    play = subprocess.run([porttape, "test", "--tape", tape.base, "--", "true"], capture_output=True, text=True, check=False)
    for name, done in (("info", info), ("cat", cat), ("test", play)):
        if done.returncode < 0 or done.returncode > 6:
            world.find(f"{name} of what is left ended with {done.returncode}: {done.stderr[-300:]}")
    if info.returncode == 0:
        said = json.loads(info.stdout)
        found = [said[side]["blocks"] if said[side] else 0 for side in ("read", "write")]
        if found != [len(tape.read), len(tape.write)]:
            world.find(f"info finds {found} blocks of {len(tape.read)} and {len(tape.write)}")
        if said["verdict"] == "sound" and (not tape.ended or tape.torn_bytes):
            world.find("info calls it sound")


def stopped(world):
    """SIGSTOP of the daemon in the middle, and of nothing else: when it goes on, nothing is lost."""
    line, port = start_recording(world)
    if check_start(world, line.daemon, there(port)):
        line.session(2)
        line.daemon.signal(signal.SIGSTOP)
        awake = threading.Timer(0.3, lambda: line.daemon.signal(signal.SIGCONT))
        awake.start()
        line.session(4)
        awake.join()
    line.stop()
    line.check()


def silent_driver(world):
    """A driver that asks and reads nothing (SIGSTOP): the end comes within its bounds, and the loss is told."""
    line, port = start_recording(world)
    if check_start(world, line.daemon, there(port)):
        line.begin()
        for number in range(6):
            text = question(1, number, LARGE[number % 4])
            try:
                os.write(line.driver.fd, text)
                line.driver.sent += text
            except BlockingIOError:
                break
        device, end = line.device, time.monotonic() + READY
        answered = sum(2 * LARGE[number % 4] for number in range(6))
        while time.monotonic() < end and len(device.sent) + len(device.pending) < answered:
            time.sleep(0.01)
    line.stop()
    of_line, _ = told_bytes(line.daemon.log)
    if line.daemon.status != 0 or of_line == 0:
        world.find(f"status {line.daemon.status}, {of_line} bytes told of {len(line.device.sent)}: {line.daemon.log[-400:]}")
    line.driver.close()
    on_tape = sum(len(data) for tape in tapes_in(line.folder) for _, data in tape.read)
    if on_tape > of_line:
        world.find(f"{on_tape} bytes came from the device, {of_line} are told that nobody read")


def folder_removed(world):
    """The tapes' folder goes in the middle, and comes back: the line stays, and the loss is told."""
    line, port = start_recording(world)
    if check_start(world, line.daemon, there(port)):
        line.session(2)
        shutil.rmtree(world.path("tapes"))
        line.session(4)
        line.daemon.signal(signal.SIGUSR1)
        line.session(2)
        os.mkdir(world.path("tapes"))
        line.session(2)
    line.stop()
    if line.broken or line.daemon.status != 1 or not tells(line.daemon.log):
        world.find(f"status {line.daemon.status}, {line.broken}: {line.daemon.log[-600:]}")


def all_troubles(place, calls, most):
    return troubles_of(place, calls, most)


def crashes(place, calls, most):
    """A kill at every write, and at every other change of a file."""
    kind = place.split("@")[0]
    if "background" in place or "/log" in place or not kind.startswith(("writev", "write.file", "ftruncate", "openat", "rename",
                                                                       "fdatasync")):
        return []
    actions = ["kill", "kill-after"] + ["torn"] * kind.startswith("write")
    return [Trouble(place, n, 1, action) for action in actions for n in nth(calls, max(most, 64))]


def hangs(place, calls, most):
    """The first channel's disk does not come back for some time, or at all."""
    if not place.startswith(("writev.tape", "fdatasync.tape", "openat.tapes", "close.tape")):
        return []
    # A later write is the loop's own until one was slow (libport/README.md, "Threads"): it must come back some time.
    never = [1] if place.startswith("writev") else sorted({1, (calls + 1) // 2})
    return ([Trouble(place, n, 1, "hang", 1500) for n in nth(calls, min(most, 4))] +
            [Trouble(place, n, FOR_EVER, "hang", 60000) for n in never])


def troubles_of_channels(place, calls, most):
    return hangs(place, calls, most) + all_troubles(place, calls, most)


def memory(place, calls, most):
    return troubles_of(place, calls, max(2, most // 4)) if place.startswith("new@") else []


def nothing(_place, _calls, _most):
    return []


@dataclasses.dataclass(frozen=True)
class Scenario:
    play: Callable
    troubles: Callable = all_troubles
    program: str = "porttaped"
    memory: bool = False


SCENARIOS = {
    "record": Scenario(record),
    "record_tcp": Scenario(record_tcp),
    "record_unix": Scenario(record_unix),
    "record_udp": Scenario(record_udp),
    "replay": Scenario(replay),
    "channels": Scenario(channels, troubles_of_channels),
    "crash": Scenario(crash, crashes),
    "record_command": Scenario(record_command, program="porttape"),
    "test": Scenario(test, program="porttape"),
    "verify": Scenario(tools("verify"), program="porttape"),
    "info": Scenario(tools("info"), program="porttape"),
    "cat": Scenario(tools("cat"), program="porttape"),
    "stopped": Scenario(stopped, nothing),
    "silent_driver": Scenario(silent_driver, nothing),
    "folder_removed": Scenario(folder_removed, nothing),
    "memory": Scenario(record, memory, memory=True),
}
