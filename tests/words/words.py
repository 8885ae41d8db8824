#!/usr/bin/env python3
"""What a user reads who typed something wrong, or gave a wrong tape: the table of both, against the real programs.

Each row: its exit status, and what its one line on stderr must have in it (regular expressions, without regard to
case): what is wrong, where, and what to type. None may say that a thing is sound or has passed, none shows a help text,
and none leaves anything behind. PORTTAPE and PORTTAPED name the programs.
"""

import os
import pty
import re
import shutil
import signal
import subprocess
import sys
import tempfile

import tapes

TOOL = os.environ["PORTTAPE"]
DAEMON = os.environ["PORTTAPED"]
os.environ.pop("CI", None)  # under it nothing is recorded, and the advice is another: the tests of cassettes have that
ADVICE = "porttape recover TAPE -o NAME keeps what is sound of it"
REACHED = re.compile(r"\b(sound|pass|passed)\b", re.IGNORECASE)
WITHOUT_ROOT = ["setpriv", "--bounding-set", "-dac_override,-dac_read_search",
                "--inh-caps", "-dac_override,-dac_read_search"]

PORTS = "--driver pty:p --device unix:s"  # of a channel that is right
NEAR = r"did you mean '{}'\?$"


def near(word):
    return NEAR.format(re.escape(word))


def record_line(port):
    return near(f"porttaped record --device {port} --driver pty:/tmp/port --tape NAME")


# The command line of porttaped, what its line must have, and the exit status where it is not 2.
DAEMON_ROWS = [
    ("", ["a verb is missing", "record, replay, bridge, run", "porttaped --help"]),
    ("recrod", ["'recrod'", near("record")]),
    ("nonsense", ["'nonsense'", "accepted: record, replay, bridge, run", "porttaped --help"]),
    ("--device /dev/ttyUSB0", ["a verb is missing before '--device'", "record, replay"]),
    ("--verison", ["'--verison'", near("--version")]),
    ("test --tape good -- true", ["verb of porttape: porttape test --tape good -- true$"]),
    ("verfiy", ["'verfiy'", near("porttape verify")]),
    ("good.log", [near("porttaped replay --tape good.log --driver pty:/tmp/port")]),
    ("good", [near("porttaped replay --tape good --driver pty:/tmp/port")]),
    ("/dev/ttyUSB0", [record_line("/dev/ttyUSB0")]),
    ("ttyUSB0", [record_line("/dev/ttyUSB0")]),
    ("record localhost:2000", [record_line("tcp:localhost:2000")]),
    ("record COM3", [record_line("/dev/ttyUSB0")]),
    ("robot.conf", [near("porttaped run robot.conf")]),
    ("record /dev/ttyUSB0", ["'/dev/ttyUSB0' stands alone", record_line("/dev/ttyUSB0")]),
    ("record --device /dev/ttyUSB0 laser", [
        "'laser' stands alone",
        near("porttaped record --device /dev/ttyUSB0 --tape laser --driver pty:/tmp/port")]),
    ("replay good.log", [near("porttaped replay --tape good.log --driver pty:/tmp/port")]),
    (f"bridge {PORTS} --faults dorp:p=1", ["option 'faults'", "'dorp'", near("drop")]),
    (f"bridge {PORTS} --faults drop:p=2", ["fault 'drop'", "key 'p' is '2'", "a probability, 0 to 1$"]),
    (f"bridge {PORTS} --faults drop:p=1,brust=2", ["fault 'drop'", "'brust'", near("burst")]),
    (f"bridge {PORTS} --faults drop", ["fault 'drop'", "does not say when", "p, byte, frame, at$"]),
    (f"bridge {PORTS} --faults drop:p=1;stall:at=-1", ["fault 'stall'", "key 'at' is '-1'", "seconds, 0 to"]),
    (f"bridge {PORTS} --faults none.faults", ["'none.faults'", "no file of that name$"]),
    (f"bridge {PORTS} --faults /dev/null", ["file '/dev/null' is no regular file", "a line each"]),
    (f"bridge {PORTS} --seed 7", ["'seed' is that of faults", "accepted: with faults$"]),
    (f"bridge {PORTS} --faults drop:p=1 --seed -1", ["'seed'", "'-1'", "a whole number, 0 or more"]),
    (f"bridge --driver pty:p --device unix:s,faults=drop:p=0 --faults drop:p=1",
     ["'device'", "it has 'faults'", "once$"]),
    (f"bridge {PORTS} more", ["'more' is not an option", "porttaped bridge --help"]),
    (f"record {PORTS}", ["'tape' is missing: NAME"]),
    ("record --driver pty:p --tape new", ["'device' is missing: PORT", "/dev/ttyUSB0"]),
    ("record --device unix:s --tape new", ["'driver' is missing: PORT", "pty:/tmp/laser"]),
    ("replay --driver pty:p", ["'tape' is missing: NAME"]),
    ("replay --tape good --driver pty:p --report ./good.loge", ["'./good.loge' is a file of the tape"]),
    ("run /dev/zero", ["'/dev/zero'", "more than a megabyte"]),
    ("replay --tape good --driver pty:p --connections each", ["'connections'", "tcp-listen:, unix-listen:"]),
    ("replay --tape good --driver unix-listen:u --connections all", ["'connections': 'all'", "one, each"]),
    ("bridge --device /dev/null --driver unix-listen:u --connections each", ["'each' gives every connection"]),
    (f"record {PORTS} --tape", ["'--tape' has no value; type --tape NAME"]),
    (f"record {PORTS} --tape=", ["'--tape'", "type --tape NAME"]),
    (f"record {PORTS} --tape \"\"", ["'--tape' is empty; type --tape NAME"]),
    (f"record {PORTS} --tape a --tape b", ["'--tape' is given twice"]),
    (f"record {PORTS} --tape a --overwrite=1", ["'--overwrite' takes no value"]),
    (f"record {PORTS} --tape a --overwite", ["'--overwite'", near("--overwrite")]),
    (f"record {PORTS} --tape a -x", ["unknown option '-x'", "porttaped record --help"]),
    (f"record {PORTS} --tape a --strictness 2", ["'strictness' is one of replay, not of record"]),
    (f"bridge {PORTS} --tape a", ["'tape' is one of record, not of bridge"]),
    ("record -device /dev/ttyUSB0", ["unknown option '-device'", near("--device")]),
    ("bridge --driver pty:p --device /dev/ttyUSB0:9600", [near("/dev/ttyUSB0,baud=9600")]),
    ("bridge --driver pty:p --device /dev/ttyUSB0,9600", [near("/dev/ttyUSB0,baud=9600")]),
    ("version", [near("--version")]),
    ("record --device /dev/ttyUSB0 --baud 9600", ["'baud' is one of a port", r"PORT,baud=RATE"]),
    (f"record {PORTS} --tape a --on-existing nxet", ["'nxet'", "refuse, next, overwrite", near("next")]),
    (f"record {PORTS} --tape /dev/null", ["'tape': '/dev/null' is a port", "NAME"]),
    (f"record {PORTS} --tape tcp:localhost:2000", ["'tape': 'tcp:localhost:2000' is a port", "NAME"]),
    (f"record {PORTS} --tape a --log-level loud", ["'log-level': 'loud'", "trace, debug, info, warn, error, off"]),
    ("bridge --driver pty:p --device ttyUSB0", ["'device': 'ttyUSB0'", near("/dev/ttyUSB0")]),
    ("bridge --driver pty:p --device dev/ttyUSB0", ["'device'", near("/dev/ttyUSB0")]),
    ("bridge --driver pty:p --device COM3", ["'COM3' is a name that Windows has", "ls -l /dev/serial/by-id"]),
    ("bridge --driver pty:p --device localhost:2000", ["'device'", near("tcp:localhost:2000")]),
    ("bridge --driver localhost:2000 --device unix:s", ["'driver'", near("tcp-listen:localhost:2000")]),
    ("bridge --driver 2000 --device unix:s", ["'driver'", near("tcp-listen:2000")]),
    ("bridge --driver pty:p --device tcp://localhost:2000", ["'device'", near("tcp:localhost:2000")]),
    ("bridge --driver /tmp/laser --device unix:s", ["'driver': '/tmp/laser'", near("pty:/tmp/laser")]),
    ("bridge --driver pty:p --device ./socket", ["'device': './socket'", near("unix:./socket")]),
    ("bridge --driver pty:p --device /tmp/laser", ["'device': '/tmp/laser'", near("serial:/tmp/laser")]),
    ("bridge --driver pty:p --device good.log", ["'good.log' is a tape", "porttaped replay --tape good.log"]),
    ("bridge --driver good --device unix:s", ["'driver': 'good' is a tape", "porttaped replay --tape good"]),
    ("bridge --driver pty:p --device device=/dev/x,baud=9600", [near("type=serial,device=/dev/x,baud=9600")]),
    ("bridge --driver pty:p --device serail:/dev/ttyUSB0", ["'serail'", near("serial")]),
    ("bridge --driver pty:p --device tty:/dev/ttyUSB0", ["'tty'", near("serial")]),
    ("bridge --driver pty:p --device modem:x", ["unknown type 'modem'", "accepted: serial, pty"]),
    ("bridge --driver pty:p --device /dev/ttyUSB0,bau=9600", ["'bau' of type serial", near("baud")]),
    ("bridge --driver pty:p --device /dev/ttyUSB0,baud=fast", ["'baud': 'fast'", "a whole number"]),
    ("bridge --driver pty:p --device /dev/ttyUSB0,parity=evne", ["'parity': 'evne'", near("even")]),
    ("bridge --driver pty:p --device tcp:localhost:70000", ["'port': '70000'", "0 to 65535"]),
    ("bridge --driver pty:p --device tcp:", ["port 'tcp:': option 'ip' is missing", "write tcp:HOST:PORT"]),
    ("bridge --driver pty:p --device tcp:h:", ["option 'port' is missing", "write tcp:HOST:PORT"]),
    ("bridge --driver pty:p --device tcp:::1:2000", [r"\[IPv6\]:PORT"]),
    ("bridge --driver pty:p --device unix", ["'path' is missing", "path of a socket"]),
    ("bridge --driver pty:p,mode=rw --device unix:s", ["'mode': 'rw'", "octal permissions like 0660"]),
    ("bridge --driver pty:p --device pty:p", ["link '.*/p' is there twice"]),
    ("bridge --driver pty:folder/no/p --device unix:socket", ["'folder/no/p'", "mkdir -p folder/no$"]),
    ("bridge --driver unix-listen:no/s --device unix:socket", ["'no/s'", "mkdir -p .*/no$"]),
    ("bridge --driver pty:file --device unix:socket", ["'file' exists and is not a link", "choose another path"]),
    ("record --driver pty:p --device unix:socket --tape no/new", ["'no/new.logr': its folder does not exist", "mkdir -p no$"]),
    ("record --driver pty:p --device unix:socket --tape good", ["'good.logr' exists", "--overwrite"]),
    ("bridge --driver pty:p --device unix:none", ["'none'", "is the program that listens there running"], 6),
    ("bridge --driver pty:p --device /dev/none", ["'/dev/none'", "plugged in", "--wait-device"], 6),
    ("bridge --driver pty:p --device serial:file", ["'file' is a file, not a serial device"], 6),
    ("bridge --driver pty:p --device {closed}", ["'{closed}'", r"it is yours and closed to you: chmod u\+rw {closed}$"],
     6),
    ("replay --tape god --driver pty:p", ["no tape 'god'", near("good")]),
    ("replay --tape nothing --driver pty:p", ["no tape 'nothing'", "'nothing.logr'"]),
    ("replay --tape good --driver pty:p --strictness 3", ["'strictness': '3'", "0 to 2"]),
    ("replay --tape good --driver pty:p --jitter 100ms", ["'jitter': '100ms'", "milliseconds", near("100")]),
    ("replay --tape good --driver pty:p --patience 500ms", ["'patience'", "seconds", near("0.5")]),
    ("replay --tape good --driver pty:p --jitter soon", ["'jitter': 'soon'", "milliseconds"]),
    ("replay --tape good --driver pty:p --jitter -1", ["'jitter': '-1'", "0 to"]),
    ("replay --tape good --driver pty:p --loops -1", ["'loops': '-1'", "0 to 1000000000"]),
    ("replay --tape good --driver pty:p --loops some", ["'loops': 'some'"]),
    ("replay --tape good --driver pty:p --at-end lop", ["'at-end': 'lop'", near("loop")]),
    ("replay --tape good --driver pty:p --start -1", ["'start': '-1'", "seconds, 0 to 1000000000"]),
    ("replay --tape good --driver pty:p --start 99", ["'start' is 99 s", "tape 'good", "0 to [0-9.]+ s"]),
    ("replay --tape good --driver pty:p --start 2 --end 1", ["'end' is '1'", "not behind the start"]),
    ("replay --tape good --driver pty:p --end 0", ["'end' is '0'", "not behind the start"]),
    ("replay --tape good --driver pty:p --preroll", ["'preroll'", "'start'"]),
    ("replay --tape good --driver pty:p --max-gap 5ms", ["'max-gap': '5ms'", "seconds"]),
    ("replay --tape good --driver pty:p --rate 0", ["'rate': '0'", "0.000001 to 1000000"]),
    ("replay --tape good --driver pty:p --timing reactiv", ["'reactiv'", near("reactive")]),
    ("replay --tape good --driver pty:p --timing none --strictness 2", ["'strictness'", "use strictness 1"]),
    ("replay --tape good --driver pty:p --match lokup", ["'lokup'", near("lookup")]),
    ("replay --tape good --driver pty:p --match lookup --strictness 2", ["'strictness'", "use strictness 1"]),
    ("replay --tape good --driver pty:p --match lookup --timing recorded", ["'match'", "timing=reactive or none"]),
    ("replay --tape good --driver pty:p --match lookup --check-settings", ["'check-settings'", "leave one of them out"]),
    ("replay --tape good --driver pty:p --on-mismatch resnyc", ["'resnyc'", near("resync")]),
    ("replay --tape good --driver pty:p --chunks random:x", ["'chunks': 'random:x'", r"random\[:SEED\]"]),
    ("replay --tape good --driver pty:p --chunks radnom", ["'radnom'", near("random")]),
    ("replay --tape good --driver pty:p --stricktness 1", [near("--strictness")]),
    ("replay --tape good --driver pty:p --report /dev/stdout --junit -", ["'junit': '-' has the report already"]),
    ("replay --tape good --driver pty:p --report - --junit /proc/self/fd/1", ["'/proc/self/fd/1' has the report already"]),
    ("replay --tape good --driver pty:p --report no/r.json", ["report 'no/r.json'", "mkdir -p .*/no$"]),
    ("replay --tape good --driver pty:p --report .", ["report '.' is a folder; name a file"]),
    ("run", ["configuration file is missing", "porttaped run CONFIG"]),
    ("run a.conf b.conf", ["'b.conf' is one too many"]),
    ("run none.conf", ["'none.conf': No such file", "porttaped run --help"]),
    ("run .", [r"'\.': Is a directory"]),
    ("run good.logr", ["good.logr:1: is not text"]),
    ("run file --chek-config", ["'--chek-config'", near("--check-config")]),
    ("record -b --pidfile file --driver pty:p --device unix:socket --tape new", ["'file' is not a pidfile"]),
    ("bridge --driver pty:p --device unix:socket --log-file no/l", ["'log-file': 'no/l': its folder does not exist; type mkdir -p"]),
]

TOOL_ROWS = [
    ("", ["a verb is missing", "info, cat", "porttape --help"]),
    ("inof good", ["'inof'", near("info")]),
    ("nonsense", ["'nonsense'", "accepted: info, cat"]),
    ("--hlep", ["'--hlep'", near("--help")]),
    ("good.log", [near("porttape info good.log")]),
    ("good", [near("porttape info good")]),
    ("/dev/ttyUSB0", [record_line("/dev/ttyUSB0")]),
    ("replay --tape good", ["verb of porttaped: porttaped replay --tape good$"]),
    ("bridgge", [near("porttaped bridge")]),
    ("info", ["no tape given", "porttape info TAPE"]),
    ("info god", ["no tape 'god'", near("good")]),
    ("verify nothing", ["no tape 'nothing'", "'nothing.logr'"]),
    ("rules", ["a verb is missing", "check, infer", "porttape rules --help"]),
    ("rules chekc good my.rules", ["'chekc'", "check, infer", near("check")]),
    ("rules check good", ["TAPE RULES", "porttape rules check --help"]),
    ("rules check nothing my.rules", ["no tape 'nothing'"]),
    ("rules check good none.rules", ["'none.rules': No such file", "porttape rules check --help"]),
    ("rules check good .", [r"'\.': Is a directory"]),
    ("rules check good file", ["file:1: this is no TOML"]),
    ("rules check good /dev/zero", ["'/dev/zero' has more than a megabyte"]),
    ("test --tape good --rules none.rules -- true", ["'none.rules': No such file"]),
    ("test --tape good --rules file -- true", ["file:1: this is no TOML"]),
    ("info --jsn good", ["'--jsn'", near("--json")]),
    ("cat good good", ["is given twice"]),
    ("cat good shortened", ["'shortened.log' has the same id as 'good.log'", "one is a copy", "porttape cut"]),
    ("merge good shortened -o new", ["'shortened.log' has the same id as 'good.log'"]),
    ("verify only_e", ["no tape 'only_e'", "there is only 'only_e.loge'"]),
    ("cat good --from 1.6 --to 1", ["--to is '1'", "later than --from"]),
    ("redact good -o new --rules -", ["rules file '-': name a file", "/dev/stdin"]),
    ("redact good -o new --rules any.rules --report - --json", ["both the report and --json"]),
    ("redact good -o new --rules any.rules --report /dev/stdout --json", ["both the report and --json"]),
    ("pack good -o new.tar.zst --redaction -", ["'redaction': - is no file"]),
    ("unpack - -o new", ["which - cannot be; name its file"]),
    ("cat good other --follow", ["--follow takes one tape"]),
    ("cat good --form 1", ["'--form'", near("--from")]),
    ("cat good --from", ["'--from' has no value; type --from S"]),
    ("cat good --from x", ["'x'", "seconds"]),
    ("cat good --dir both", ["'both'", "r or w"]),
    ("cat good --blocks=1", ["'--blocks' takes no value"]),
    ("test", ["command is missing", r"porttape test --tape NAME .options. -- COMMAND"]),
    ("test -- true", ["'tape' is missing: NAME"]),
    ("test --tape good", ["command is missing", r"porttape test --tape NAME .options. -- COMMAND"]),
    ("test --tape good ./driver --device {port}", ["porttape test --tape good -- ./driver --device {port}$"]),
    ("--json info good", ["'--json' belongs behind the verb: porttape info --json good$"]),
    ("test good -- true", ["--tape is missing before 'good'; type porttape test --tape good -- true$"]),
    ("test --tape good more -- true", ["'more' is not an option"]),
    ("test --tape god -- true", ["no tape 'god'", near("good")]),
    ("test --tape good --driver ttyUSB0 -- true", ["'driver': 'ttyUSB0'", near("/dev/ttyUSB0")]),
    ("test --tape good --timeout 5min -- true", ["'timeout': '5min'", "seconds", near("300")]),
    ("test --tape good --chunks brust -- true", ["'brust'", near("burst")]),
    ("test --tape good --report no/r.json -- true", ["'no/r.json'", "mkdir -p .*/no$"]),
    ("test --tape good --report good.logr -- true", ["'good.logr' is a file of the tape"]),
    ("test --tape good --faults dorp:p=1 -- true", ["option 'faults'", "'dorp'", near("drop")]),
    ("test --tape good --seed 1 -- true", ["'seed' is that of faults"]),
    ("saok", ["'saok'", near("soak")]),
    ("soak --tape good", ["command is missing", "porttape soak --tape NAME .*-- COMMAND"]),
    ("soak -- true", ["'tape' is missing: NAME"]),
    ("soak --tape god -- true", ["no tape 'god'", near("good")]),
    ("soak --tape good --seeds 9..1 -- true", ["'seeds': '9..1'", "A..B", "1..1000$"]),
    ("soak --tape good --seeds x -- true", ["'seeds': 'x'", "A..B"]),
    ("soak --tape good --seed 3 -- true", ["'--seed'"]),
    ("soak --tape good --jobs 0 -- true", ["'jobs': '0'", "1 to 1000$"]),
    ("soak --tape good --fails-by statsu -- true", ["'fails-by': 'statsu'", near("status")]),
    ("soak --tape good --faults corrupt:p=1,xr=20 -- true", ["fault 'corrupt'", "'xr'", near("xor")]),
    ("soak --tape good --format xml -- true", ["'format': 'xml'", "text, json$"]),
    ("soak --tape good --timing nne -- true", ["'timing': 'nne'", near("none")]),
    ("soak --tape good -- false", ["without any fault, too", "status 1", "porttape test --tape good.log"], 1),
    ("shrink --tape good -o small -- true", ["'faults' is missing", "porttape soak"]),
    ("shrink --tape good --faults drop:p=1 -- true", ["'output' is missing: -o NAME"]),
    ("shrink --tape good --faults drop:p=1 -o good -- true", ["'good.logr' exists"]),
    ("shrink --tape good --faults drop:byte=9999 -o small -- true", ["it does not fail", "soak"], 1),
    ("record", ["command is missing", "porttape record --device PORT --tape NAME"]),
    ("record /dev/ttyUSB0 -- true", ["--device is missing", "porttape record --device /dev/ttyUSB0 --tape NAME -- "]),
    ("record --device unix:socket --tape good -- true", ["'good.logr' exists", "--on-existing next", "--overwrite"]),
    ("record --device unix:socket --tape no/new -- true", ["'no/new.logr': its folder does not exist", "mkdir -p no$"]),
    ("record --device ttyUSB0 --tape new -- true", ["'device': 'ttyUSB0'", near("/dev/ttyUSB0")]),
    ("record --device unix:socket --tape new ./driver", ["porttape record --device unix:socket --tape new -- ./driver$"]),
    ("record --device unix:socket --tape new --fail-closd -- true", ["'--fail-closd'", near("--fail-closed")]),
    ("test --tape good --session 7 -- true", ["'session'", "has 1 session, and no number 7"]),
    ("test --tape good --session first -- true", ["'session' is 'first'", "accepted: all, or the number"]),
    ("test --tape good --connections each -- true", ["'connections'", "tcp-listen:, unix-listen:"]),
    ("exec", ["command is missing", "porttape exec [--device PORT]".replace("[", r"\[").replace("]", r"\]")]),
    ("probe", ["command is missing", r"porttape probe \[--json\] -- COMMAND"]),
    ("probe -- ./no-such-driver", ["'./no-such-driver' cannot be run: No such file"]),
    ("exec -- true", ["--device PORT is missing, or --tape NAME", "porttape exec --device PORT"]),
    ("exec --tap -- true", ["--tape NAME is missing", "porttape exec --tap --tape NAME"]),
    ("exec --tap --tape new --driver pty:p -- true", ["--driver does not go with --tap"]),
    ("exec --tap --tape new --device tcp:host:1 -- true", ["'tcp:host:1'", "the path of the serial device"]),
    ("exec --tap --tape new --device /dev/fd -- true", ["'/dev/fd' is no tty"]),
    ("exec --tap --tape new -- cat {port}", ["{port} is the path of --device"]),
    ("exec --tape gone -- true", ["no tape 'gone'"]),
    ("exec --tape good --lines maybe -- true", ["'lines'", "accepted: on, off, loopback"]),
    ("exec --tape good --as ttyUSB0 -- true", ["option 'as': port 'ttyUSB0' is not below /dev", "such as /dev/ttyUSB0"]),
    ("exec --tape good --as /dev/ttyUSB0,vdi=0403 -- true", ["'as'", "'vdi'", near("vid")]),
    ("exec --tape good --as /dev/ttyUSB0,vid=0403 -- true", ["'as'", "a vid and no pid", "vid=0403,pid=6001"]),
    ("exec --tape good --as /dev/null -- true", ["'as'", "'/dev/null' is a name that every program needs"]),
    ("record --as /dev/ttyUSB0 --device unix:s --tape new -- true", ["'as' goes with --exec"]),
    ("exec --tape good --driver unix-listen:e -- true", ["unix-listen:e is no tty", "leave out --driver"]),
    ("exec --tape good -- ./no-such-driver", ["'./no-such-driver' cannot be run: No such file"]),
    ("record --lines on --device unix:s --tape new -- true", ["'lines' goes with --exec"]),
    ("test --lines on --tape good -- true", ["'lines' goes with --exec"]),
    ("drive", ["no tape given", "porttape drive TAPE --device PORT"]),
    ("drive good", ["'device' is missing: PORT"]),
    ("drive good /dev/ttyUSB0", ["--device is missing before '/dev/ttyUSB0'; type porttape drive good --device /dev/ttyUSB0$"]),
    ("drive good ttyUSB0", ["--device is missing before 'ttyUSB0'; type porttape drive good --device /dev/ttyUSB0$"]),
    ("drive good --device unix:s more", ["'more' is not an option", "porttape drive --help"]),
    ("drive good --device ttyUSB0", ["'device': 'ttyUSB0'", near("/dev/ttyUSB0")]),
    ("drive god --device unix:s", ["no tape 'god'", near("good")]),
    ("drive good --device unix:s --timeout soon", ["'timeout': 'soon'", "seconds"]),
    ("drive good --device unix:s --timming none", ["'--timming'", near("--timing")]),
    ("drive good --device unix:s --strictness 2 --timing none", ["'strictness'", "timing=none"]),
    ("drive good --device unix:s --report good.logr", ["'good.logr' is a file of the tape"]),
    ("drive good --device unix-listen:q --session 7", ["'session'", "has 1 session, and no number 7"]),
    ("drive good --device unix:s --on-mismatch resync", ["'on-mismatch': 'resync'", "accepted: fail, warn"]),
    ("drive good --device unix:s --match lookup", ["unknown option '--match'"]),
    ("drvie good", ["'drvie'", near("drive")]),
    ("cat god --follow", ["begins when a driver first opens", "no tape 'god'", near("good")]),
    ("cat good --color maybe", ["'color': 'maybe'", "auto, always, never"]),
    ("ctl", ["no verb given", "mark, pause, resume, step, seek, rate, stop"]),
    ("ctl puase", ["'puase'", near("pause")]),
    ("ctl pause now", ["pause takes no more words", "-c"]),
    ("ctl seek", ["the time is missing", "ctl seek 12.5"]),
    ("ctl rate", ["the rate is missing", "ctl rate 0.5"]),
    ("ctl mrak here", ["'mrak'", near("mark")]),
    ("ctl mark", ["the text is missing"]),
    ("ctl -p x stop", ["'x'", "the number of a process"]),
    ("status more", ["'more' is too much"]),
    ("status --jsno", ["'--jsno'", near("--json")]),
    ("test --tape good --junit no/j.xml -- true", ["'no/j.xml'", "mkdir -p .*/no$"]),
    ("test --tape good --junit good.logr -- true", ["'good.logr' is a file of the tape"]),
    ("test --tape good --format xml -- true", ["'format': 'xml'", "text, json, tap"]),
    ("test --tape good -j 2 -- true", ["'jobs' goes with --suite DIR"]),
    ("test --suite .", ["suite '.': there is no suite.toml in it"]),
    ("test --suite . --tape good", ["'tape' is of one test, and does not go with --suite"]),
    ("test --suite . -- true", ["has its commands in suite.toml"]),
    ("test --tape gone --record-mode once -- true", ["no tape 'gone'", "there is no --device to record it from"]),
    ("test --tape good --record-mode all -- true", ["'record-mode': 'all'", "none, once"]),
    ("bless --tape gone -- true", ["no tape 'gone'"]),
    ("bless --tape good", ["command is missing", r"porttape bless --tape NAME .options. -- COMMAND"]),
    ("bless --tape good --output good -- true", ["there is a tape 'good.log' already"]),
    ("test --tape good -- ./no-such-driver", ["'./no-such-driver' cannot be run: No such file"]),
    ("convert", ["nothing is given to convert"]),
    ("convert good", ["'output' is missing: -o OUT"]),
    ("convert good -o new", ["'good' is a tape already", "--to FORMAT"]),
    ("convert good -o new --to tex", ["'to': 'tex' is unknown", "convert --formats", near("text")]),
    ("convert good -o new --from text", ["'good' cannot be read", "No such file"]),
    ("convert good.logw -o - --from raw", ["a tape is several files", "--to FORMAT"]),
    ("convert good --to text -o good.loge --overwrite", ["good.loge"]),
    ("cut good --from 0 -o -", ["a tape is several files"]),
    ("merge good -o -", ["a tape is several files"]),
    ("recover good -o -", ["a tape is several files"]),
    ("split good -o -", ["a tape is several files"]),
    ("convert - -o new", ["'from' is missing: what - is"]),
    ("convert /dev/null -o new", ["'from' is missing: what /dev/null is"]),
    ("convert nothing.txt -o new", ["no such file, and no tape 'nothing.txt'"]),
    ("convert . -o new", ["'.' is a folder; name a file"]),
    ("convert good.logw -o new --from raw --lead soon", ["'lead': 'soon'", "seconds"]),
    ("convert good.logw -o new --from raw --bytes-at 0", ["'bytes-at': '0' is no rate"]),
    ("convert good.logw -o none/new --from raw", ["'none/new.logr': its folder does not exist", "mkdir -p none$"]),
    ("convert good -o folder --to text", ["'folder' is no regular file"]),
    ("convert good -o new --to text --swap", ["'swap' has no effect on a tape"]),
    ("convert good -o new --to text --lead 2", ["'lead' has no effect on a tape"]),
    ("convert good -o new --to text --device x", ["'device' has no effect on a tape"]),
    ("convert good -o new --to text --with good.logw", ["'with' has no effect on a tape"]),
    ("convert good -o new --to csv --bytes-at 9600", ["'bytes-at' has no effect on a tape that becomes csv"]),
    ("convert good good -o new --to text", ["more than one input given"]),
    ("convert nothing -o new --to text", ["no tape 'nothing'"]),
    ("plot good", ["-o FILE is missing"]),
    ("plot good -o good.logr", ["is a file of the tape"]),
    ("plot good -o none/x.svg", ["its folder does not exist", "mkdir -p"]),
    ("plot nothing -o x.svg", ["no tape 'nothing'"]),
    ("cat good --find (", ["--find", "is no regular expression"]),
    ("cat good --as bin", ["--as is 'bin'", "both, text or hex"]),
    ("cat good --time utc", ["--time is 'utc'", "tape, delta or wall"]),
    ("stats nothing", ["no tape 'nothing'"]),
    ("stats good good", ["more than one tape given"]),
    ("stats good --protocol nmae", ["'protocol': 'nmae' is not known", "nmea", "rules file"]),
    ("stats good --protocol nmea --rules file", ["one of them"]),
    ("stats good --rules nowhere", ["nowhere"]),
    ("stats good --silence 0", ["'silence': '0' is no time", "seconds"]),
    ("stats good --exchange", ["'--exchange'", near("--exchanges")]),
    ("view good", ["-o FILE is missing"]),
    ("view good good good -o x.html", ["more than two tapes"]),
    ("view good -o good.logr", ["is a file of the tape"]),
    ("view good -o none/x.html", ["its folder does not exist", "mkdir -p"]),
    ("view good nothing -o x.html", ["no tape 'nothing'"]),
    ("diff good", ["two tapes are compared, 1 given"]),
    ("diff good nothing", ["no tape 'nothing'"]),
    ("diff good good --margin soon", ["'margin': 'soon'", "seconds", "off"]),
    ("diff good good --html good.logr", ["is a file of the tape"]),
    ("diff good good --html none/x.html", ["its folder does not exist", "mkdir -p"]),
    ("diff good good --html file", ["'file' exists already", "--overwrite"]),
    ("diff good good --json --html -", ["both the page and JSON would go to stdout"]),
    ("diff good good --jsno", ["'--jsno'", near("--json")]),
    ("cut good", ["'output' is missing: -o NAME"]),
    ("cut good -o new", ["nothing says what is to be kept", "--from, --to, --exchange, --mark"]),
    ("cut good -o new --from 0 --mark a..b", ["'from' and 'mark' do not go together"]),
    ("cut good -o new --from soon", ["'from': 'soon'", "seconds"]),
    ("cut good -o new --from 2 --to 1", ["'to': '1'", "later than --from"]),
    ("cut good -o new --from 1000", ["nothing is cut out of 'good.log'", r"from 1000\.000000 s on: it ends at"]),
    ("cut good -o new --exchange 3..1", ["'exchange': '3..1'", "4..7"]),
    ("cut good -o new --exchange 1000", ["it has only [0-9]+ exchanges"]),
    ("cut good -o new --mark begin..end", ["no mark 'begin'", "it has no marks"]),
    ("cut good -o good --from 0", ["there is a tape 'good.log' already", "--overwrite"]),
    ("cut good -o none/new --from 0", ["'none/new.logr': its folder does not exist", "mkdir -p none$"]),
    ("cut nothing -o new --from 0", ["no tape 'nothing'"]),
    ("cut good good -o new --from 0", ["more than one tape given"]),
    ("cut good -o new --rebsae", ["'--rebsae'", near("--rebase")]),
    ("recover good", ["'output' is missing: -o NAME"]),
    ("recover nothing -o new", ["no tape 'nothing'"]),
    ("recover good -o good", ["there is a tape 'good.log' already", "--overwrite"]),
    ("recover good other -o new", ["more than one tape given"]),
    ("split good", ["'output' is missing: -o NAME"]),
    ("split good -o new --at-mark --every 5", ["'at-mark' and 'every' do not go together"]),
    ("split good -o new --every 0", ["'every': '0'", "above 0"]),
    ("split good -o new --gap long", ["'gap': 'long'", "seconds"]),
    ("split nothing -o new", ["no tape 'nothing'"]),
    ("split good -o none/new", ["'none/new.1.logr': its folder does not exist", "mkdir -p none$"]),
    ("split good other -o new", ["more than one tape given"]),
    ("merge good -o new", ["one tape is nothing to merge"]),
    ("merge good good -o new", ["'good.log' is given twice"]),
    ("merge good nothing -o new", ["no tape 'nothing'"]),
    ("merge good other", ["'output' is missing: -o NAME"]),
    ("merge good other -o new --offset later", ["'offset': 'later'", "12.5,-3"]),
    ("merge good other -o new --offset 1,2", ["2 offsets are given for 1 tapes"]),
    ("redact good --rules none.rules", ["'output' is missing: -o NAME"]),
    ("redact good -o new", ["'rules' is missing: --rules FILE"]),
    ("redact good -o new --rules none.rules", ["rules file 'none.rules': No such file"]),
    ("redact good -o new --dry-run --rules none.rules", ["'dry-run' and 'output' do not go together"]),
    ("redact nothing -o new --rules none.rules", ["no tape 'nothing'"]),
    ("redact good other -o new --rules none.rules", ["more than one tape given"]),
    ("redact good -o new --rules any.rules --report file", ["report 'file' exists already", "--overwrite"]),
    ("redact good -o new --rules any.rules --report any.rules --overwrite", ["'any.rules' is 'any.rules', which is read"]),
    ("redact good -o new --rules nameless.rules", [r"nameless.rules:1: \[\[redact\]\] lacks 'name'"]),
    ("redact good -o new --dry-rnu", ["'--dry-rnu'", near("--dry-run")]),
    ("pack good", ["'output' is missing: -o FILE"]),
    ("pack nothing -o new.tar.zst", ["no tape 'nothing'"]),
    ("pack good good -o new.tar.zst", ["two tapes are called 'good.log'"]),
    ("pack good -o file", ["'file' exists already", "--overwrite"]),
    ("pack good -o none/new.tar.zst", ["'none/new.tar.zst': its folder does not exist", "mkdir -p none"]),
    ("pack good -o new.tar.zst --redaction file", ["'file' is no report of porttape redact"]),
    ("pack good -o new.tar.zst --facts --no-facts", ["'facts' and 'no-facts' do not go together"]),
    ("unpack", ["pack is missing"]),
    ("unpack file", ["'output' is missing: -o DIR"]),
    ("unpack file other -o new", ["more than one pack given"]),
    ("unpack nothing -o new", ["cannot read nothing: No such file"]),
    ("unpack file -o .", ["folder '.': it is there already"]),
    ("unpack file -o none/new", ["folder 'none/new': its folder does not exist", "mkdir -p none$"]),
    ("unpack file -o new", ["pack 'file': it is no"]),
    ("unpack file -o new --max-size all", ["'max-size': 'all'", "megabytes"]),
    ("rules infer good -o new.rules", ["one tape shows nothing that differs", "porttape rules infer good TAPE2 -o RULES"]),
    ("rules infer good good", ["'output' is missing: RULES", "-o FILE"]),
    ("rules infer good nothing -o new.rules", ["no tape 'nothing'"]),
    ("rules infer good good -o file", ["'file' is there already", "--overwrite"]),
    ("rules infer good good -o none/new.rules", ["rules file 'none/new.rules'", "mkdir -p"]),
    ("rules infer good good -o - --changes many", ["'changes': 'many'", "accepted: 1 to"]),
    ("rules infer good good --outptu x", ["'--outptu'", near("--output")]),
    ("rules infre good good -o -", ["'infre' is no verb", near("infer")]),
]

# A configuration, and the lines of the answer, each with its file and line in front.
CONFIGURATIONS = [
    ("", ["1: there is no section"]),
    ("device = unix:s\n", ["1: 'device' is in no section; write .channel NAME."]),
    ("[laser]\ndevice = unix:s\n", [r"1: '\[laser\]' is no section; " + NEAR.format(r"\[channel laser\]")]),
    ("[channel a]\nwords\ndriver=pty:p\ndevice=unix:s\n", ["2: 'words' is neither KEY = VALUE nor"]),
    ("[channel a]\nb.device=unix:s\ndriver=pty:p\ndevice=unix:s\n", ["2: unknown option 'b.device' of bridge"]),
    ("[channel a]\ndriver=pty:p\n", ["1: option 'device' is missing"]),
    ("[channel a]\ndriver=pty:p\ndevice=unix:s\ndriver=pty:q\n", ["4: option 'driver' is there twice, first in line 2"]),
    ("[channel a]\ndriver=pty:p\ndevice=unix:s\n[channel a]\n", ["4: channel 'a' is there twice, first in line 1"]),
    ("[channel a]\ndriver=pty:p\ndevice=unix:s\n[channel b]\ndriver=pty:./p\ndevice=unix:t\n",
     ["5: link '.*/p' is that of channel 'a'"]),
    ("# three at once\n[channel a]\ndriver=/tmp/x\ndevcie=unix:s\ntape=t\njitter=5ms\n",
     ["3: .*" + near("pty:/tmp/x"), "4: .*" + near("device"), "6: option 'jitter'.*" + near("5")]),
]

# A tape; the words that verify, cat and `porttaped replay` have of it, and their exit statuses. None: it can be
# printed or played, and nothing is said. AS_VERIFIED: what verify says.
NOT_AS_TOLD = (1, "by its tape's end it has")
AS_VERIFIED = ()
TAPE_ROWS = [
    ("missing_r", (1, "missing_r.logr is missing"), AS_VERIFIED, NOT_AS_TOLD),
    ("missing_w", (1, "missing_w.logw is missing"), AS_VERIFIED, NOT_AS_TOLD),
    ("missing_e", (0, "no events file"), None, None),
    ("swapped", (1, "are swapped"), AS_VERIFIED, NOT_AS_TOLD),
    ("foreign_e", (1, "foreign_e.loge may be another tape's"), AS_VERIFIED, NOT_AS_TOLD),
    ("foreign_r", (1, "foreign_r.logr is shortened, or another tape's"), AS_VERIFIED, NOT_AS_TOLD),
    ("mixed", (1, "mixed.logw is shortened, or another tape's"), AS_VERIFIED, NOT_AS_TOLD),
    ("shortened", (1, "shortened.logr is shortened"), AS_VERIFIED, NOT_AS_TOLD),
    ("changed", (1, "changed.logr is another tape's, or changed"), AS_VERIFIED, (1, "changed.logr is another")),
    ("torn", (1, "torn tail at offset 147"), (1, "torn.logr is shortened"), NOT_AS_TOLD),
    ("length", (1, "length.logr is damaged at offset 84"), (1, "damaged at offset 84"), None),
    ("time", (1, "time goes back from"), (1, "time goes back from"), NOT_AS_TOLD),
    ("micros", (1, "microseconds are 1000000"), (1, "microseconds are 1000000"), None),
    ("trailing", (1, "trailing.logr is damaged at offset 168"), (1, "damaged at offset 168"), NOT_AS_TOLD),
    ("text", (2, "not a tape: text.logr"), (2, "text.logr is not a file of a tape"), (2, "text.logr is not a file")),
    ("binary", (1, "binary.logr is not a file of a tape"), AS_VERIFIED, (1, "binary.logr is not")),
    ("empty", (1, "empty.logr is shortened"), AS_VERIFIED, NOT_AS_TOLD),
    ("events_damaged", (1, "damaged in line 2"), (1, "damaged in line 2"), (1, "damaged in line 2")),
    ("events_text", (1, "not an events file"), AS_VERIFIED, (1, "not an events file")),
    ("events_cut", (0, "has no end"), None, None),
    ("native", (0, "no events file"), None, None),
    ("two_layouts", (2, "different layouts"), (2, "different layouts"), (2, "different layouts")),
    ("being_written", (0, "is being written"), None, None),
    ("closed", (2, "closed.logr.*Permission denied"), (2, "closed.logr.*denied"), (2, "closed.logr.*denied")),
    ("fifo", (2, "fifo.logr is a FIFO; a tape is made of regular"), (2, "is a FIFO"), (2, "is a FIFO")),
    ("folder", (2, "folder.logr is a folder; a tape is made of"), (2, "is a folder"), (2, "is a folder")),
    ("loop", (2, "'loop.logr', a link that leads nowhere"), (2, "leads nowhere"), (2, "leads nowhere")),
]

failures = []
count = 0


def complain(what, command, text):
    failures.append(f"{what}\n  {' '.join(command)}\n  {text}")


def state():
    found = []
    for folder, _, names in os.walk("."):
        for name in names:
            path = os.path.join(folder, name)
            status = os.lstat(path)
            found.append((path, status.st_mode, status.st_size, status.st_mtime_ns))
    return sorted(found)


def run(command):
    """Status, stdout and stderr; with the rights that a user has, root too."""
    global count
    count += 1
    as_user = WITHOUT_ROOT if os.geteuid() == 0 else []
    done = subprocess.run(as_user + command, capture_output=True, timeout=120, stdin=subprocess.DEVNULL, check=False)
    return done.returncode, done.stdout.decode(errors="replace"), done.stderr.decode(errors="replace")


def check_words(command, status, text, want, patterns):
    if status != want:
        complain(f"exit {status} instead of {want}", command, text)
    for pattern in patterns:
        if not re.search(pattern, text, re.IGNORECASE | re.MULTILINE):
            complain(f"no /{pattern}/", command, text)
    if REACHED.search(text.replace(ADVICE, "")):
        complain("says that all is well", command, text)
    if "Usage" in text:
        complain("shows a help text", command, text)


def wrong_invocation(program, line, patterns, want=2):
    command = [program] + [word.replace('""', "") for word in line.split()]
    before = state()
    status, out, err = run(command)
    check_words(command, status, err.rstrip("\n"), want, patterns)
    if out or len(err.splitlines()) != 1:
        complain("is not one line on stderr", command, out + err)
    if state() != before:
        complain("left something behind", command, str(set(state()) ^ set(before)))


def wrong_configuration(text, lines):
    with open("wrong.conf", "w", encoding="utf-8") as file:
        file.write(text)
    for more in ([], ["--check-config"]):
        command = [DAEMON, "run", "wrong.conf", *more]
        status, out, err = run(command)
        check_words(command, status, err, 2, [])
        told = err.splitlines()
        if out or len(told) != len(lines):
            complain(f"tells {len(told)} things instead of {len(lines)}", command, out + err)
        for line, pattern in zip(told, lines):
            if not re.search("wrong.conf:" + pattern, line):
                complain(f"no /{pattern}/", command, line)


def replayed(name):
    """What the daemon says of a tape, which it plays until it is ended."""
    global count
    count += 1
    command = [DAEMON, "replay", "--tape", name, "--driver", "pty:played"]
    with subprocess.Popen(WITHOUT_ROOT * (os.geteuid() == 0) + command, stderr=subprocess.PIPE) as process:
        tapes.until(f"the port of {name}", lambda: os.path.lexists("played") or process.poll() is not None)
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        err = process.communicate(timeout=120)[1].decode(errors="replace")
    return command, process.returncode, err


# What makes another tape or file of one, or judges it. What is drawn of a damaged tape says so itself.
OF_TAPES = ["cut {} --from 0 -o new", "split {} -o new", "merge missing_e {} --offset 1 -o new",
            "redact {} --rules any.rules -o new", "convert {} --to text -o new.txt", "diff good {}", "stats {}",
            "plot {} -o new.svg", "view {} -o new.html"]


def damaged_source(name):
    for line in OF_TAPES:
        command = [TOOL] + line.format(name).split()
        before = state()
        status, _, err = run(command)
        check_words(command, status, err, 1, ["porttape recover"])
        if command[1] in ("plot", "view") and os.path.exists(command[-1]):
            os.unlink(command[-1])
        if state() != before:
            complain("left something behind", command, str(set(state()) ^ set(before)))


def wrong_tape(name, verified, printed, played):
    command = [TOOL, "verify", name]
    status, out, err = run(command)
    check_words(command, status, out + err, verified[0], [verified[1]])
    command = [TOOL, "info", name]
    status, out, err = run(command)
    check_words(command, status, out + err, verified[0], [verified[1].removeprefix("not a tape: ")])
    if printed is AS_VERIFIED:
        printed = verified
    if verified[0] == 1:
        damaged_source(name)
    command = [TOOL, "cat", name]
    status, out, err = run(command)
    check_words(command, status, err, *((printed[0], [printed[1]]) if printed else (0, ["^$"])))
    if len(err.splitlines()) > 1:
        complain("is not one line on stderr", command, err)
    command, status, err = replayed(name)
    if played:
        check_words(command, status, err, played[0], [played[1]])
        command = [TOOL, "test", "--tape", name, "--", "true"]
        status, out, err = run(command)
        check_words(command, status, out + err, played[0], [played[1]])
        return
    if REACHED.search(err):
        complain("says that all is well", command, err)
    command = [TOOL, "test", "--tape", name, "--", "true"]
    status, out, err = run(command)
    check_words(command, status, out + err, 5, ["incomplete: the command never opened its port"])


def helps():
    """Every help text: on stdout, and in 80 columns."""
    verbs = {TOOL: ["", "info", "cat", "record", "test", "drive", "exec", "probe", "verify", "recover", "cut", "split",
                    "merge", "convert", "plot", "view", "stats", "diff", "redact", "pack", "unpack", "rules",
                    "rules check", "rules infer", "status", "ctl"],
             DAEMON: ["", "record", "replay", "bridge", "run"]}
    commands = [[TOOL, "convert", "--formats"]]
    for program, names in verbs.items():
        for name in names:
            options = ("-h", "--help", "--help-ports") if program == DAEMON or not name else ("-h", "--help")
            commands += [[program, *name.split(), option] for option in options]
    for command in commands:
        status, out, err = run(command)
        long = [line for line in out.splitlines() if len(line) > 80]
        if status != 0 or err or not out or long:
            complain(f"exit {status}, or lines of more than 80 characters {long}", command, err)


def main():
    samples = [DAEMON_ROWS, TOOL_ROWS, TAPE_ROWS]
    assert len(samples[0]) + len(samples[1]) >= 60 and len(samples[2]) >= 20
    master, slave = pty.openpty()
    closed = os.ttyname(slave)
    os.chmod(closed, 0)
    lock = tapes.make(DAEMON)
    os.mkdir("folder")
    listener = tapes.socket.socket(tapes.socket.AF_UNIX)
    listener.bind("socket")
    listener.listen()
    with open("file", "w", encoding="utf-8") as file:
        file.write("not ours\n")
    with open("nameless.rules", "w", encoding="utf-8") as file:
        file.write("[[redact]]\ntext = 'nowhere'\n")
    with open("any.rules", "w", encoding="utf-8") as file:
        file.write("[[redact]]\nname = 'any'\ntext = 'nowhere'\n")
    for program, rows in ((DAEMON, DAEMON_ROWS), (TOOL, TOOL_ROWS)):
        for line, patterns, *want in rows:
            named = [each.replace("{closed}", closed) for each in patterns]
            wrong_invocation(program, line.replace("{closed}", closed), named, *want)
    for text, lines in CONFIGURATIONS:
        wrong_configuration(text, lines)
    for row in TAPE_ROWS:
        wrong_tape(*row)
    helps()
    for each in (listener, lock):
        each.close()
    for each in (master, slave):
        os.close(each)


def in_folder():
    folder = tempfile.mkdtemp(prefix="porttape-words.")
    try:
        os.chdir(folder)
        main()
    finally:
        os.chdir("/")
        shutil.rmtree(folder, ignore_errors=True)
    for failure in failures:
        print(f"words: FAIL: {failure}", file=sys.stderr)
    if failures:
        sys.exit(f"words: {len(failures)} complaints in {count} cases")
    print(f"words: {count} cases")


if __name__ == "__main__":
    in_folder()
