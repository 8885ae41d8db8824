"""The drivers, and the device of each."""

import re

from far import arduino, chip, transfer
from far.echo import Echo
from far.gps import Gps
from far.meter import Meter
from far.modem import Modem
from far.ups import ApcSmart, Megatec
from parts.case import ROOT, Case, Exec, NodeModule, Unpacked

BOOTLOADER = Unpacked("arduino-core-avr",
                      "usr/share/arduino/hardware/arduino/avr/bootloaders/optiboot/optiboot_atmega328.hex")


def few_polls(least):
    def judge(device, _folder):
        return None if device.polls >= least else f"{device.polls} polls, expected {least} or more"
    return judge


# gpsd empties both queues right behind some of its writes. A UART's driver has sent them by then, since gpsd waits for
# that; a pty's never waits: some of them are lost on any pty, each time others. gpsd.rules says which; all the rest must be
# as recorded. Its tapes are replayed by the clock: a receiver speaks without being asked.
# How far it gets at a wrong rate is its own matter each time: what it writes meanwhile is not looked at.
UNCHECKED = ["--strictness", "0", "--timing", "recorded"]
BY_RULES = ["--timing", "recorded", "--rules", str(ROOT / "tests/drivers/gpsd.rules")]
FLUSHED_BY_GPSD = re.compile(rb"\$PASHQ,RID\*28\r\n|@F0\.3=1\*67\r\n|@F2\.2=1\*64\r\n|%dm%dm@51\r\n"
                             rb"|%vendor%print,/par/rcv/vendor@0A\r\n|@@Cj\)\r\n|@@@@\r\nMAW0C0B\r\n")


def not_flushed_by_gpsd(data):
    return FLUSHED_BY_GPSD.sub(b"", data)


def without_over_and_out(data):
    """lrzsz's sz ends with the two bytes OO and flushes them away: on any pty they may get lost."""
    return re.sub(rb"OO$", b"", data)


def only_over_and_out(report):
    sent, mismatch = report["from_driver"], report["mismatch"]
    missing = not mismatch and sent["of"] - sent["matched"] == 2
    extra = mismatch and mismatch["kind"] == "extra" and mismatch["got_hex"] == "4f4f"
    return "but for OO" if missing or extra else None


def holds(**expected):
    """A judge of a tape: how many events of these kinds it has at least."""
    def judge(tape):
        missing = [kind for kind, least in expected.items() if tape.count(kind.replace("_", "-")) < least]
        return f"too few events: {', '.join(missing)}" if missing else None
    return judge


def made_mode(*modes):
    """A judge of a tape: the driver made its line so, in this order (`19200 7O1`), whatever it made between."""
    def judge(tape):
        made = [f"{event.get('baud')} {event.get('databits')}{event.get('parity', '?')[:1].upper()}{event.get('stopbits')}"
                for event in tape.events if event["event"] == "settings" and event.get("by") == "driver"]
        sampled = [event for event in tape.events if event["event"] == "settings" and event.get("order") == "sampled"]
        if sampled:
            return f"no exact place has {sampled[0]}"
        rest = iter(made)
        missing = [mode for mode in modes if mode not in rest]
        return f"not made: {', '.join(missing)}; but {', '.join(made)}" if missing else None
    return judge


def both(*judges):
    return lambda tape: next(filter(None, (judge(tape) for judge in judges)), None)


def over_and_out(tape):
    return None if tape.written.endswith(b"OO") else f"the end is {tape.written[-8:]!r}, not OO"


def dump_of(size):
    def prepare(folder):
        (folder / "flash.bin").write_bytes(chip.flash_of(chip.FLASH, size))
    return prepare


# What serial ports of this machine there are is none of a test's business: the names are of the driver's own /dev.
AS_ADAPTER = ["--as", "/dev/ttyUSB0,vid=0403,pid=6001,serial=PT1"]
LOW_BATTERY = ["--lines", "cts=off,dsr=on,cd=on,ri=off"]
ON_BATTERY = ["--lines", "cts=off,dsr=off,cd=on,ri=off"]
LOOPBACK = ["--lines", "loopback"]
SERIALPORT = NodeModule("serialport", "12.0.0")

CASES = [
    Case("gpsd_nmea", "gpsd reads a receiver that speaks NMEA; it tries another rate and parity first",
         ["gpsd", "gpsd-clients"], ["gpsd.sh", "20"], lambda _: Gps(4800), 4800,
         comparable=not_flushed_by_gpsd, replay=BY_RULES),
    Case("gpsd_ubx", "gpsd configures a u-blox receiver",
         ["gpsd", "gpsd-clients"], ["gpsd.sh", "20"], lambda _: Gps(38400, binary=True), 38400,
         comparable=not_flushed_by_gpsd, replay=BY_RULES),
    Case("gpsd_rate", "gpsd has a u-blox receiver speak at 38400, and follows it",
         ["gpsd", "gpsd-clients"], ["gpsd.sh", "20", "38400"], lambda _: Gps(9600, binary=True), 9600,
         comparable=not_flushed_by_gpsd, replay=BY_RULES),
    Case("gpsd_hunt", "gpsd finds a receiver of 4800 on a line of 19200; it gives each rate some 9000 reads",
         ["gpsd", "gpsd-clients"], ["gpsd.sh", "20"], lambda _: Gps(4800, drips=True), 19200,
         comparable=not_flushed_by_gpsd, replay=UNCHECKED),
    Case("gpsd_b", "gpsd -b only listens",
         ["gpsd", "gpsd-clients"], ["gpsd.sh", "20", "-b"], lambda _: Gps(9600), 9600),
    Case("nutdrv_qx", "NUT reads a Megatec UPS",
         ["nut-server"], ["nut.sh", "nutdrv_qx", "5"], lambda _: Megatec(), 9600, judge=few_polls(5)),
    Case("nutdrv_qx_held", "the same as it runs for ever: on a tape of some three seconds, any poll is answered (lookup)",
         ["nut-server", "nut-client"], ["nut_held.sh", "2"], lambda _: Megatec(), 9600, judge=few_polls(2),
         replay=["--match", "lookup"], replay_script=["nut_held.sh", "27"]),
    Case("blazer_ser", "NUT's older driver for the same",
         ["nut-server"], ["nut.sh", "blazer_ser", "5"], lambda _: Megatec(), 9600, judge=few_polls(5)),
    Case("apcsmart", "NUT reads an APC Smart-UPS: canonical mode, a flush for each command",
         ["nut-server"], ["nut.sh", "apcsmart", "5"], lambda _: ApcSmart(), 9600, judge=few_polls(5)),
    Case("kermit", "C-Kermit hangs up by B0, and transfers files at two rates",
         ["ckermit"], ["kermit.sh"], transfer.kermit, 9600, prepare=transfer.make_files, judge=transfer.received_whole),
    Case("avrdude", "avrdude writes an Arduino by its bootloader, and reads it back",
         ["avrdude", "gcc", "libc6-dev", "libsimavr-dev"], ["avrdude.sh"],
         lambda folder: arduino.arduino(folder, BOOTLOADER.path()), 9600, prepare=arduino.make_program,
         unpacked=[BOOTLOADER]),
    # Where the port has no modem lines, gammu leaves it at the B0 it begins with: the phone here takes any rate.
    Case("gammu", "gammu asks a phone who it is, and sends a message",
         ["gammu"], ["gammu.sh"], lambda _: Modem(), 9600),
    Case("gammu_keep", "the same with settings=keep: the phone's line stays at 115200",
         ["gammu"], ["gammu.sh"], lambda _: Modem(), 115200, device_options="settings=keep"),
    Case("sz", "lrzsz sends a file by ZMODEM, with XON/XOFF",
         ["lrzsz"], ["lrzsz.sh", "sz"], transfer.rz, 9600, prepare=transfer.make_files, judge=transfer.received_whole,
         comparable=without_over_and_out, forgives=only_over_and_out),
    Case("rz", "lrzsz gets one",
         ["lrzsz"], ["lrzsz.sh", "rz"], transfer.sz, 9600, prepare=transfer.make_files),
    Case("ser2net", "ser2net's client sets rates, stop bits and flow control",
         ["ser2net"], ["ser2net.sh"], lambda _: Echo(None), 9600),
    # Those that a pty is not enough for. The far end has no signals of its own, as any pty: --lines gives them, and a tape
    # of it has none either.
    Case("statserial", "statserial shows the signals of the line",
         ["statserial"], ["statserial.sh"], lambda _: Echo(None), 9600,
         exec=Exec("TIOCMGET failed: Inappropriate ioctl", ["--lines", "on"])),
    Case("genericups", "NUT holds a UPS that has nothing but signals: its battery is low",
         ["nut-server"], ["genericups.sh", "3", "LB OL"], lambda _: Echo(None), 9600,
         exec=Exec("TIOCMSET: Inappropriate ioctl", LOW_BATTERY, tape=holds(modem=1))),
    Case("genericups_ob", "another one: it is on its battery",
         ["nut-server"], ["genericups.sh", "4", "OB"], lambda _: Echo(None), 9600,
         exec=Exec("TIOCMSET: Inappropriate ioctl", ON_BATTERY, tape=holds(modem=1))),
    Case("kermit_lines", "C-Kermit watches the carrier and waits for signals",
         ["ckermit"], ["kermit_lines.sh"], lambda _: Echo(None), 9600,
         exec=Exec("no signals|signals unavailable", ["--lines", "on"])),
    Case("stm32flash", "stm32flash reads a chip by its boot loader, at 8E1",
         ["stm32flash"], ["stm32flash.sh"], lambda _: chip.Chip(), 9600, prepare=dump_of(4096),
         exec=Exec("Failed to set terminal flags", tape=made_mode("57600 8E1"))),
    Case("pyserial", "pyserial has parity twice, signals, breaks, RS485, low latency",
         ["python3-serial"], ["pyserial_lines.sh"], lambda _: Echo(None), 9600,
         exec=Exec("Invalid argument|Inappropriate ioctl", LOOPBACK,
                   tape=both(made_mode("9600 8E1", "9600 7E1", "9600 7O1", "9600 8E1", "9600 7E1"),
                             holds(modem=4, **{"break": 4})))),
    Case("list_ports", "pyserial and udevadm find an adapter by its ids, and names in /dev lead to it",
         ["python3-serial", "udev"], ["list_ports.sh"], lambda _: Echo(None), 9600,
         exec=Exec("is not listed", AS_ADAPTER, AS_ADAPTER)),
    Case("sigrok", "libserialport finds its port, at 7 data bits with parity, and sigrok takes five readings of a meter",
         ["sigrok-cli"], ["sigrok.sh"], lambda _: Meter(), 19200,
         exec=Exec("invalid parameters", AS_ADAPTER, AS_ADAPTER,
                   tape=both(made_mode("19200 7E1"), holds(modem=2)))),
    Case("node", "node's serialport lists an adapter, opens it at 7E1 and reads its signals",
         ["nodejs", "udev"], ["node.sh"], lambda _: Echo(None), 9600, unpacked=[SERIALPORT],
         exec=Exec("is not listed", AS_ADAPTER, AS_ADAPTER, tape=made_mode("9600 7E1"))),
    Case("sz_exec", "lrzsz's sz again: the two bytes it flushes away at last reach the device, and the tape",
         ["lrzsz"], ["lrzsz.sh", "sz"], transfer.rz, 9600, prepare=transfer.make_files, judge=transfer.received_whole,
         exec=Exec(tape=over_and_out)),
]
