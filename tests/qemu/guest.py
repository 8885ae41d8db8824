"""What the guest of `run` does: its checks, one after the other. Runs as its first process, and turns it off at the end.

A check is a function named check_NAME, here, in exec_checks.py or in tap_checks.py; it returns what it saw, or raises. Each has a folder of its own
in /run.
"""

import contextlib
import fcntl
import os
import pathlib
import re
import select
import subprocess
import sys
import termios
import time
import traceback
import tty

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from rig import (BUSYBOX, BY_ID, BY_ID_DEVICE, HERE, PATIENCE, PORTTAPE, PYTHON, WORDS, Daemon, Wrong,  # noqa: E402
                 bridge, command, contains_in_order, events, far, line_of, modem_of, need, need_sound,
                 opened, plug, say, unplug, until, wire)
import exec_checks  # noqa: E402
import tap_checks  # noqa: E402

# ---- the checks

RATES = ["115200", "9600", "250000", "1200/2", "4000000"]
BAUDS = [int(rate.partition("/")[0]) for rate in RATES]


def check_record(folder):
    tape, begin = folder / "tape", len(wire.settings)
    with far("/dev/ttyGS0"):
        command(PORTTAPE, "record", "--device", "/dev/ttyACM0,baud=57600", "--tape", str(tape), "--",
                PYTHON, str(HERE / "driver.py"), "{port}", *RATES)
        need_sound(tape)
    sizes = [pathlib.Path(f"{tape}.log{kind}").stat().st_size for kind in "rw"]
    del wire.settings[:begin]
    return f"15 exchanges over ttyACM0 at 5 rates, tape sound ({sizes[0]} + {sizes[1]} bytes)"


def check_rates(_):
    need(wire.settings, "the device was told no rate")
    rates, wanted = wire.rates(), [57600, *BAUDS, 57600]
    need(contains_in_order(rates, wanted), f"the device was told the rates {rates}, not {wanted}")
    need((1200, 2, "n", 8) in wire.settings, f"two stop bits did not reach the device: {wire.settings}")
    return f"USB device told {' '.join(map(str, rates))}"


def check_tape_settings(folder):
    told = events(folder.parent / "record" / "tape", "settings")
    by_driver = [event["baud"] for event in told if event.get("by") == "driver" and "baud" in event]
    need(any(event.get("by") == "device" and event.get("baud") == 57600 for event in told), f"not the device's own: {told}")
    need(contains_in_order(by_driver, BAUDS), f"the driver's rates on tape: {by_driver}")
    return f"tape: device 57600, driver {' '.join(map(str, by_driver))}"


def check_replay(folder):
    told = command(PORTTAPE, "test", "--tape", str(folder.parent / "record" / "tape"), "--check-settings", "--",
                   PYTHON, str(HERE / "driver.py"), "{port}", *RATES)
    need("pass" in told, told)
    return told


def check_replay_acm(folder):
    """The tape at the far end of the real tty: an unmodified driver on ttyACM0."""
    daemon = Daemon(folder, "replay", "--tape", str(folder.parent / "record" / "tape"), "--driver", "serial:/dev/ttyGS0",
                    "--strictness", "1")
    try:
        until(lambda: "/dev/ttyGS0" in open_files(daemon.process.pid), daemon.text)
        command(PYTHON, str(HERE / "driver.py"), "/dev/ttyACM0", *RATES)
    finally:
        status = daemon.stop()
    need(status == 0, f"the replay ended with {status}: {daemon.text()}")
    return "the tape answers on ttyGS0, the driver is on ttyACM0"


def open_files(pid):
    found = []
    for entry in pathlib.Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            found.append(os.readlink(entry))
    return found


def check_unplug(folder):
    tape = folder / "tape"
    with far("/dev/ttyGS0"), bridge(folder, "/dev/ttyACM0,baud=57600", tape=tape) as daemon:
        with opened(folder / "port") as port:
            port.exchange(b"before")
            unplug()
            need(port.read(PATIENCE) == b"", "the driver's line does not hang up")
        daemon.need_alive()
        until(lambda: daemon.logged("is lost"), lambda: "the log does not say it: " + daemon.text())
        need(plug() == "/dev/ttyACM0", "the device came back as another")
        with opened(folder / "port") as port:
            port.exchange(b"after")
    lost = events(tape, "device-lost")
    need(len(lost) == 1, f"device-lost on the tape: {lost}")
    return f"the driver's line hung up, the daemon went on, the next open found it again; device-lost at {lost[0]['t_us']} us"


def check_unplug_replayed(folder):
    """The tape of it hangs up in the same place."""
    tape = folder.parent / "unplug" / "tape"
    daemon = Daemon(folder, "replay", "--tape", str(tape), "--driver", f"pty:{folder}/port", wait_for=folder / "port")
    try:
        with opened(folder / "port") as port:
            port.exchange(b"before")
            need(port.read(PATIENCE) == b"", "the replay does not hang up")
        with opened(folder / "port") as port:
            port.exchange(b"after")
    finally:
        daemon.stop()
    return "the tape of it hangs up in the same place"


def check_replug(folder):
    """Unplugged in mid-session with `alwaysopen`; back as ttyACM1, since somebody holds ttyACM0.

    It is found by a link whose folder was gone meanwhile.
    """
    tape = folder / "tape"
    with far("/dev/ttyGS0"), bridge(folder, BY_ID_DEVICE, tape=tape) as daemon:
        with opened(folder / "port") as port:
            port.set(19200)
            port.exchange(b"before")
            holder = os.open("/dev/ttyACM0", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            try:
                unplug()
                until(lambda: daemon.logged("is lost"), daemon.text)
                now = plug()
            finally:
                os.close(holder)
            need(now == "/dev/ttyACM1", f"the device came back as {now}")
            until(lambda: daemon.logged("is back"), lambda: "not found again: " + daemon.text())
            port.exchange(b"after, on the same open port")
            until(lambda: wire.settings[-1][0] == 19200, lambda: f"the device was told {wire.settings[-3:]}, not 19200")
    need(events(tape, "device-lost") and events(tape, "device-back"), pathlib.Path(f"{tape}.loge").read_text())
    return f"ttyACM1 by {BY_ID}, the driver's port stayed open, its rate is made again; device-lost and device-back on the tape"


def check_replug_rate(folder):
    """A device that is plugged in again has the rate that the driver has set, not that of the options."""
    unplug()
    need(plug() == "/dev/ttyACM0", "the device is not ttyACM0 again")
    with far("/dev/ttyGS0"), bridge(folder, BY_ID_DEVICE) as daemon:
        with opened(folder / "port") as port:
            port.set(19200)
            port.exchange(b"before")
            until(lambda: line_of("/dev/ttyACM0")[0] == 19200, lambda: f"{line_of('/dev/ttyACM0')}")
            unplug()
            until(lambda: daemon.logged("is lost"), daemon.text)
            del wire.settings[:]
            plug()
            until(lambda: daemon.logged("is back"), daemon.text)
            port.exchange(b"after")
            got = line_of("/dev/ttyACM0")[0]
    need(got == 19200, f"{got} baud")
    return "19200 again after unplug and replug"


def check_line_coding(folder):
    """Parity, data and stop bits of the options reach a USB device too."""
    with far("/dev/ttyGS0"), bridge(folder, "/dev/ttyACM0,baud=57600,parity=odd,databits=7,stopbits=2"):
        with opened(folder / "port") as port:
            port.exchange(b"x")
            until(lambda: wire.settings[-1:] == [(57600, 2, "o", 7)], lambda: f"it was told {wire.settings[-3:]}")
    return "USB device told 57600 7O2"


def check_stuck(folder):
    """A device that reads nothing holds up neither a change of the rate, nor an unplug, nor the daemon's end."""
    silent = os.open("/dev/ttyGS0", os.O_RDWR | os.O_NOCTTY)
    tty.setraw(silent)
    daemon = Daemon(folder, "bridge", "--device", "/dev/ttyACM0,baud=57600", "--driver", f"pty:{folder}/port",
                    wait_for=folder / "port")
    try:
        with opened(folder / "port") as port:
            written = fill(port.fd)
            port.set(9600)
            until(lambda: wire.rates()[-1:] == [9600], lambda: f"the rate does not reach the device: {wire.rates()[-3:]}")
            os.close(silent)
            unplug()
            need(hangs_up(port.fd), "the driver's line does not hang up")
        daemon.need_alive()
        plug()
        silent = os.open("/dev/ttyGS0", os.O_RDWR | os.O_NOCTTY)
        tty.setraw(silent)
        with opened(folder / "port") as port:
            fill(port.fd)
            begin = time.monotonic()
            daemon.stop()
            took = time.monotonic() - begin
    finally:
        daemon.stop()
        os.close(silent)
        unplug()  # what nobody read goes with it
    return f"{written} bytes unread: the rate came through, the unplug hung up, SIGTERM took {took:.1f} s"


def fill(fd):
    """Writes until there is no room for a second."""
    os.set_blocking(fd, False)
    count = 0
    while select.select([], [fd], [], 1)[1]:
        with contextlib.suppress(BlockingIOError):
            count += os.write(fd, bytes(1024))
    return count


def hangs_up(fd):
    poll = select.poll()
    poll.register(fd, 0)
    return any(events & select.POLLHUP for _, events in poll.poll(PATIENCE * 1000))


def check_b0(folder):
    """B0 hangs up a modem: DTR falls, and rises with the next rate."""
    with far("/dev/ttyGS0"), bridge(folder, "/dev/ttyACM0,baud=57600"):
        with opened(folder / "port") as port:
            port.exchange(b"before")
            need(wire.modem and wire.modem[-1] & 1, f"DTR is not up: {wire.modem}")
            port.set(0)
            until(lambda: not wire.modem[-1] & 1, "DTR does not fall")
            port.set(57600)
            until(lambda: wire.modem[-1] & 1, "DTR does not rise again")
            port.exchange(b"after")
    return "DTR falls at B0 and rises with the next rate"


def check_keep(folder):
    """settings=keep: nothing that the driver sets reaches the device."""
    with far("/dev/ttyGS0"), bridge(folder, "/dev/ttyACM0,baud=57600,settings=keep"):
        with opened(folder / "port") as port:
            port.exchange(b"before")
            port.set(1200)
            port.exchange(b"after")
            got = line_of("/dev/ttyACM0")[0]
    need(got == 57600, f"{got} baud")
    return "57600 stays"


def check_parity(folder):
    """Parity, data and stop bits of the options are the line's; a driver that asks for them, twice, gets no error."""
    with far("/dev/ttyS2"), bridge(folder, "/dev/ttyS1,baud=19200,parity=even,databits=7,stopbits=2"):
        with opened(folder / "port") as port:
            port.exchange(b"seven bits")
            got = line_of("/dev/ttyS1")
            need(got == (19200, 7, "even", 2), f"the line has {got}")
            mode = termios.tcgetattr(port.fd)
            mode[2] = mode[2] & ~termios.CSIZE | termios.CS7 | termios.PARENB | termios.CSTOPB | termios.CLOCAL
            for _ in range(3):
                termios.tcsetattr(port.fd, termios.TCSANOW, mode)
                port.exchange(b"asked for them")
            got = line_of("/dev/ttyS1")
            need(got == (19200, 7, "even", 2), f"the line has {got} after the driver's request")
    return "8250: 19200 7E2 from the options; tcsetattr(7E2) three times: no error"


def check_refused(folder):
    """A rate that the UART cannot make."""
    with far("/dev/ttyS2"), bridge(folder, "/dev/ttyS1,baud=19200") as daemon:
        with opened(folder / "port") as port:
            for _ in range(5):
                port.set(250000)
                port.exchange(b"x")
                port.set(38400)
                port.exchange(b"y")
            got = line_of("/dev/ttyS1")
            need(got[0] == 38400, f"the line has {got}")
        told = daemon.logged(r"(?i)warning.*(?:250000|not take).*")
    need(len(told) == 1, f"told {len(told)} times: {told}")
    return f"8250 at 250000, asked five times: {told[0]}"


def check_refused_read_back(folder):
    """What the line has is what the driver reads back."""
    with far("/dev/ttyS2"), bridge(folder, "/dev/ttyS1,baud=19200"):
        with opened(folder / "port") as port:
            port.set(250000)
            port.exchange(b"x")
            has = line_of("/dev/ttyS1")[0]
            until(lambda: port.baud() == has, lambda: f"the line has {has}, the driver reads {port.baud()}")
    return f"8250 asked for 250000 has {has}, and the driver reads {has}"


def check_ftdi(folder):
    tape = folder / "tape"
    with far("/dev/ttyS3"), bridge(folder, "/dev/ttyUSB0,baud=115200,parity=odd", tape=tape):
        with opened(folder / "port") as port:
            port.exchange(b"hello")
            need(line_of("/dev/ttyUSB0") == (115200, 8, "odd", 1), f"{line_of('/dev/ttyUSB0')}")
            port.set(250000)
            port.exchange(b"at 250000")
            until(lambda: line_of("/dev/ttyUSB0")[0] == 250000, lambda: f"{line_of('/dev/ttyUSB0')}")
    need_sound(tape)
    after = line_of("/dev/ttyUSB0")
    need(after[:3] == (115200, 8, "odd"), f"left with {after}")
    return "ttyUSB0: 115200 8O1, the driver's 250000, 115200 again at the end; tape sound"


def check_modem_options(folder):
    with far("/dev/ttyS2"), bridge(folder, "/dev/ttyS1,baud=19200,dtr=off,rts=on"):
        with opened(folder / "port") as port:
            port.exchange(b"x")
            got = modem_of(1)
    need(got == (False, True), f"(DTR, RTS) are {got}")
    return "8250: DTR off, RTS on"


AS_NOBODY = """
import os, sys
os.setuid(65534)
try:
    os.close(os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK))
except OSError as error:
    sys.exit(error.errno)
"""


def open_as_nobody(path):
    """0, or errno."""
    return subprocess.run([PYTHON, "-c", AS_NOBODY, path], check=False, timeout=PATIENCE).returncode


def check_exclusive(folder):
    """TIOCEXCL: while a session has the device nobody else has; then anybody."""
    os.chmod("/dev/ttyS1", 0o666)
    need(open_as_nobody("/dev/ttyS1") == 0, "nobody cannot open it before")
    with far("/dev/ttyS2"), bridge(folder, "/dev/ttyS1,baud=19200"):
        with opened(folder / "port") as port:
            port.exchange(b"x")
            need(open_as_nobody("/dev/ttyS1") == 16, "another program opens the device in mid-session")  # EBUSY
        until(lambda: open_as_nobody("/dev/ttyS1") == 0, "the device stays locked after the session")
        with opened(folder / "port") as port:
            port.exchange(b"again")
    return "another user's open in mid-session is EBUSY, and works after it"


def check_flock(folder):
    """Locks meet on a real tty: somebody else's keeps the daemon off, the daemon's keeps others off."""
    with far("/dev/ttyS2"), bridge(folder, "/dev/ttyS1,baud=19200") as daemon:
        other = os.open("/dev/ttyS1", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
            with opened(folder / "port") as port:
                need(port.read(PATIENCE) == b"", "a device that is locked is used")
            need(daemon.logged("busy"), "the log does not say why: " + daemon.text())
            fcntl.flock(other, fcntl.LOCK_UN)
            with opened(folder / "port") as port:
                port.exchange(b"x")
                try:
                    fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    raise Wrong("another program locks the device in mid-session")
                except BlockingIOError:
                    pass
        finally:
            os.close(other)
    return "a device that is locked is busy, and told so; one in use cannot be locked"


def pyserial_result(folder, port):
    tool = HERE.parent / "pyserial" / "run"
    done = subprocess.run([PYTHON, "-B", str(tool), "--tests", WORDS["porttape.pyserial"], "--port", str(port)],
                          capture_output=True, text=True, timeout=600, check=False)
    (folder / "pyserial.txt").write_text(done.stdout)
    need("cases" in done.stdout, done.stdout + done.stderr)
    return done.stdout.strip().splitlines()


def excused():
    """The cases that fail on any pty, of the table in tests/pyserial/README.md."""
    return set(re.findall(r"^\| `([\w.]+)`", (HERE.parent / "pyserial" / "README.md").read_text(encoding="utf-8"), re.M))


def check_pyserial_direct(folder):
    with far("/dev/ttyS2", bytes):
        lines = pyserial_result(folder, "/dev/ttyS1")
    return f"{lines[-1]}: {', '.join(line.split()[0] for line in lines[:-1])}"


def check_pyserial_bridge(folder):
    """What passes on a UART passes through a bridge to it, but for what a pty cannot do."""
    direct = {line.split()[0] for line in (folder.parent / "pyserial_direct" / "pyserial.txt").read_text().splitlines()[:-1]}
    with far("/dev/ttyS2", bytes), bridge(folder, "/dev/ttyS1"):
        lines = pyserial_result(folder, folder / "port")
    more = [line for line in lines[:-1] if line.split()[0] not in direct | excused()]
    need(not more, "; ".join(more))
    return f"{lines[-1]}, none that passes on the UART and could pass on a pty"


NEEDS = {"rates": ["record"], "tape_settings": ["record"], "replay": ["record"], "replay_acm": ["record"],
         "unplug_replayed": ["unplug"], "pyserial_bridge": ["pyserial_direct"]}

CHECKS = {name[len("check_"):]: check for name, check in [*globals().items(), *vars(exec_checks).items(), *vars(tap_checks).items()]
          if name.startswith("check_")}


def run_check(name):
    folder = pathlib.Path("/run/checks") / name
    folder.mkdir(parents=True)
    try:
        say(f"ok {name} {CHECKS[name](folder)}")
    except Exception as error:  # each check stands for itself
        traceback.print_exc()
        say(f"WRONG {name} {type(error).__name__}: {error}")
    finally:
        with contextlib.suppress(Exception):
            plug()


def main():
    os.environ["TMPDIR"] = "/run/tmp"
    os.mkdir("/run/tmp")
    os.chmod("/run/tmp", 0o1777)
    names = list(CHECKS)
    if "porttape.pyserial" not in WORDS:
        names = [name for name in names if not name.startswith("pyserial")]
    wanted = [name for name in WORDS.get("porttape.only", "").split(",") if name]
    wanted += [need for name in wanted for need in NEEDS.get(name, [])]
    plug()
    for name in names:
        if not wanted or name in wanted:
            run_check(name)


try:
    main()
except Exception:
    traceback.print_exc()
else:
    say("end")
finally:
    os.sync()
    subprocess.run([BUSYBOX, "poweroff", "-f"], check=False)
