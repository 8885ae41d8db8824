"""The drivers, and the device of each."""

import re

from far import arduino, transfer
from far.echo import Echo
from far.gps import Gps
from far.modem import Modem
from far.ups import ApcSmart, Megatec
from parts.case import ROOT, Case, Unpacked

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
]
