"""gpsd fed by a log: plainly, by its own gpsfake, and from the log's tape."""

import fcntl
import json
import os
import re
import signal
import socket
import subprocess
import time

from logs import SPEED

PATIENCE = 120  # seconds for what comes in one; only ends what hangs
WATCH = b'?WATCH={"json":true,"nmea":true}\n'  # as gpsfake's


class Failed(Exception):
    """What did not work, in words."""


def ipc_of_its_own():
    """What to put before a gpsd that root starts: its shared memory outlives it, since it is root no more when it ends."""
    alone = ["unshare", "--ipc"]
    works = os.geteuid() == 0 and not subprocess.run([*alone, "true"], stderr=subprocess.DEVNULL, check=False).returncode
    return alone if works else []


ALONE = ipc_of_its_own()


def plain(log, folder):
    """What gpsd says when gpsfake feeds it, in the way of gpsd's regress-driver."""
    environment = {**os.environ, "TMPDIR": str(folder)}
    command = [*ALONE, "gpsfake", "-s", str(SPEED), "-1", "-p", "-q", str(log.path)]
    with open(folder / "gpsfake.log", "wb") as errors:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors, env=environment,
                                   start_new_session=True)
    try:
        return process.communicate(timeout=PATIENCE)[0]
    except subprocess.TimeoutExpired:
        raise Failed(f"gpsfake has not ended after {PATIENCE} s") from None
    finally:
        end_group(process)


def end_group(process):
    """gpsfake's gpsd goes with it."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    process.wait()
    process.stdout.close()


def stop(process):
    if process.poll() is None:
        process.terminate()
    try:
        return process.wait(20)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return None


class Gpsd:
    """A gpsd that opens what it is told to when a client watches, and writes to nothing that its driver's probes need not.

    It is given its sockets as by systemd: nobody has to wait for them, and no number is taken twice.
    """

    def __init__(self, folder):
        self.control = folder / "gpsd.sock"
        with socket.socket(socket.AF_UNIX) as control, socket.create_server(("127.0.0.1", 0)) as clients:
            control.bind(str(self.control))
            control.listen()
            self.place = clients.getsockname()
            self.process = self.start(folder, control, clients)

    @staticmethod
    def start(folder, *sockets):
        given = [fcntl.fcntl(each.fileno(), fcntl.F_DUPFD_CLOEXEC, 10) for each in sockets]  # away from 3 and 4
        script = "LISTEN_PID=$$ LISTEN_FDS=2 exec gpsd -b -N 3<&{0} 4<&{1} {0}<&- {1}<&-".format(*given)
        environment = {**os.environ, "GPSD_SHM_KEY": hex(0x47700000 + sockets[1].getsockname()[1]),
                       "PATH": os.environ["PATH"] + ":/usr/sbin"}
        try:
            with open(folder / "gpsd.log", "wb") as said:
                return subprocess.Popen([*ALONE, "bash", "-c", script], stdin=subprocess.DEVNULL, stdout=said, stderr=said,
                                        pass_fds=given, env=environment)
        finally:
            for each in given:
                os.close(each)

    def add(self, device):
        with socket.socket(socket.AF_UNIX) as line:
            line.settimeout(PATIENCE)
            line.connect(str(self.control))
            line.sendall(f"+{device}\r\n\0".encode())
            if (answer := line.recv(12)) != b"OK\n":
                raise Failed(f"gpsd does not take {device}, and says {answer!r}")

    def stop(self):
        stop(self.process)


class Tape:
    """A porttaped that plays a tape on a port of its own; its clock stands until `go`."""

    def __init__(self, log, folder, programs, pace_us):
        self.programs = programs
        self.environment = {**os.environ, "RUNTIME_DIRECTORY": str(folder / "control")}
        self.seconds = log.write_tape(str(folder / "tape.log"), pace_us) / 1_000_000
        self.log = folder / "porttaped.log"
        port, self.device = {"pty": lambda: ("pty:,mode=0666", None), "TCP": lambda: ("tcp-listen:127.0.0.1:0", None),
                             "UDP": udp_place}[log.transport]()
        command = [programs / "daemon/porttaped", "replay", "--tape", folder / "tape", "--driver", port, "--strictness", "0",
                   "--start-paused", "--once", "--log-file", self.log]
        self.process = subprocess.Popen(list(map(str, command)), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                        env=self.environment)
        if self.device is None:
            self.device = self.told_device(log.transport)

    def told_device(self, transport):
        told = self.process.stdout.readline().decode().strip()
        if not told:
            raise Failed(f"porttaped does not start: {self.words()}")
        return told if transport == "pty" else "tcp://" + re.sub(r"^tcp(-listen)?:", "", told)

    def go(self):
        done = subprocess.run([self.programs / "tools/porttape", "ctl", "-p", str(self.process.pid), "resume"],
                              env=self.environment, capture_output=True, text=True, check=False)
        if done.returncode:
            raise Failed(f"porttape ctl resume: {done.stderr.strip()}")

    def verdict(self):
        """Fails where porttaped ends otherwise than with a pass."""
        try:
            status = self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            raise Failed("porttaped does not end with the run") from None
        if status:
            raise Failed(f"porttaped ends with {status}: {self.words()}")

    def words(self):
        return self.log.read_text(encoding="utf-8", errors="replace")[-500:] if self.log.exists() else ""

    def stop(self):
        stop(self.process)
        self.process.stdout.close()


def udp_place():
    """Where gpsd will listen: the port of a datagram socket that was just there, as gpsfake finds it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind(("127.0.0.1", 0))
        host, port = line.getsockname()
    return f"udp:{host}:{port}", f"udp://{host}:{port}"


def listen(gpsd, tape):
    """What gpsd tells its client, up to the device's end. The tape begins when gpsd has the device open, and says so."""
    said, going, deadline = b"", False, time.monotonic() + PATIENCE
    with socket.create_connection(gpsd.place, PATIENCE) as line, line.makefile("rb") as answers:
        line.sendall(WATCH)
        while True:
            try:
                line.settimeout(max(0.1, deadline - time.monotonic()))
                answer = answers.readline()
            except TimeoutError:
                raise Failed(f"gpsd has not told of the device's end; its last words: {said[-200:]!r}") from None
            if not answer:
                raise Failed("gpsd has hung up")
            said += answer
            if not going and answer.startswith(b'{"class":"WATCH"'):
                tape.go()
                going, deadline = True, time.monotonic() + tape.seconds + PATIENCE
            if answer.startswith(b'{"class":"DEVICE",') and json.loads(answer).get("activated") == 0:
                return said


def from_tape(log, folder, programs, pace_us):
    """What gpsd says when the log's tape is its device."""
    tape = gpsd = None
    try:
        tape = Tape(log, folder, programs, pace_us)
        gpsd = Gpsd(folder)
        gpsd.add(tape.device)
        said = listen(gpsd, tape)
        (folder / "said").write_bytes(said)
        tape.verdict()
        return said
    finally:
        for each in (gpsd, tape):
            if each:
                each.stop()
