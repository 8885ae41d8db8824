"""The sections: what is measured, and how."""

import json
import os
import platform
import re
import shutil
import signal
import statistics
import subprocess
import time

from .table import Table

MIB = 1 << 20
SECTIONS = ["rtt", "busy", "throughput", "tcp", "channels", "ptys", "delivery", "verify", "memory", "idle", "start", "exec"]


class Failed(Exception):
    pass


class Bench:
    """Every section is a method that adds rows to the table. `effort`: quick (that it works), pair (one of many takes that
    are compared; nothing beside porttape is measured), normal or full."""

    def __init__(self, effort, programs, folder):
        self.programs, self.folder, self.table, self.effort = programs, folder, Table(), effort
        if effort == "pair":
            self.programs = {**programs, "socat": None}

    def sized(self, quick, pair, normal):
        return {"quick": quick, "pair": pair}.get(self.effort, normal)

    def linebench(self, *words):
        child = subprocess.Popen([str(self.programs["linebench"]), *map(str, words)], stdout=subprocess.PIPE,
                                 stderr=subprocess.PIPE, text=True, env={**os.environ, "TMPDIR": str(self.folder)})
        try:
            out, errors = child.communicate()
        except BaseException:
            child.send_signal(signal.SIGINT)
            child.wait()
            raise
        if child.returncode != 0:
            raise Failed(f"linebench {words[0]}: {errors.strip()}")
        return [json.loads(line) for line in out.splitlines()]

    def daemon(self, verb, *words):
        return " ".join([str(self.programs["porttaped"]), verb, *map(str, words), "--driver pty:{driver}", "--log-level warn"])

    def relays(self, recording):
        """The lines to compare, as linebench --relay arguments."""
        end = "PTY,link={driver},raw,echo=0 FILE:{device},raw,echo=0"
        socat, relays = self.programs["socat"], {}
        if not recording:
            relays["bare"] = ""
        if socat:
            relays["socat"] = f"{socat} " + ("-r {dir}/r -R {dir}/w " if recording else "") + end
        if self.programs["porttaped"]:
            if not recording:
                relays["bridge"] = self.daemon("bridge", "--device serial:{device}")
            relays["record"] = self.daemon("record", "--device serial:{device}", "--tape {dir}/t.log", "--overwrite")
        return [word for name, command in relays.items() for word in ("--relay", f"{name}={command}")]

    def rtt(self, busy=0):
        rounds, count = self.sized((2, 50), (3, 300), (21 if busy == 0 else 11, 600))
        lines = {line["name"]: line for line in self.linebench(
            "rtt", *self.relays(False), "--rounds", rounds, "--count", count, "--warmup", count // 10, "--busy", busy)}
        load = f", {busy} busy cores" if busy else ""
        for key, title in (("p50", "median"), ("p99", "p99")):
            for name, line in lines.items():
                base = "socat" if name in ("bridge", "record") and "socat" in lines else "bare"
                if name == "bare":
                    self.table.add(f"round trip {title}, bare pty{load}", line[key + "_us"], "us")
                    continue
                ratio = statistics.median(a / b for a, b in zip(line[key + "_rounds"], lines[base][key + "_rounds"]))
                target = 1.0 if (name, key, base, busy) == ("record", "p50", "socat", 0) else None
                self.table.add(f"round trip {title}, {name}{load}", line[key + "_us"], "us", lines[base][key + "_us"],
                               base, ratio, most=target)
        for name, line in lines.items():
            if name not in ("bare", "socat") and "socat" in lines:
                self.table.add(f"CPU a round trip, {name}{load}", line["relay_cpu_us"], "us", lines["socat"]["relay_cpu_us"],
                               "socat", line["relay_cpu_us"] / max(lines["socat"]["relay_cpu_us"], 1e-9))

    def busy(self):
        self.rtt(busy=os.cpu_count() or 1)

    def throughput(self):
        size, rounds = self.sized((MIB, 1), (8 * MIB, 1), (32 * MIB, 5))
        relays = self.relays(True)
        if not relays:
            return self.table.skip("throughput", "neither socat nor porttaped")
        tape = ["--tape", "record=t.log"] if self.programs["porttaped"] else []
        lines = {(line["name"], line["direction"]): line for line in self.linebench(
            "throughput", *relays, *tape, "--bytes", size, "--rounds", rounds)}
        for direction, title in (("to_driver", "to driver"), ("to_device", "to device"), ("both", "both ways")):
            base, line = lines.get(("socat", direction)), lines.get(("record", direction))
            if not base or not line:
                only = base or line
                self.table.add(f"recording {title}, {only['name']}", only["MBps"], "MB/s")
                continue
            ratio = statistics.median(a / b for a, b in zip(line["MBps_rounds"], base["MBps_rounds"]))
            self.table.add(f"recording {title}", line["MBps"], "MB/s", base["MBps"], "socat -r -R", ratio, least=1.0)
            cpu, base_cpu = line["relay_cpu_ms_per_MB"], base["relay_cpu_ms_per_MB"]
            self.table.add(f"CPU recording {title}", cpu, "ms/MB", base_cpu, "socat -r -R", cpu / base_cpu)

    def tcp(self):
        if not self.programs["porttaped"]:
            return self.table.skip("TCP", "porttaped is not built")
        ends = "--device tcp:127.0.0.1:{device_port} --driver tcp-listen:127.0.0.1:{driver_port}"
        record = f"record={self.programs['porttaped']} record {ends} --tape {{dir}}/t.log --overwrite --log-level warn"
        relays = ["--relay", record]
        if self.programs["socat"]:
            relays += ["--relay", f"socat={self.programs['socat']} TCP-LISTEN:{{driver_port}},bind=127.0.0.1,nodelay "
                                  "TCP:127.0.0.1:{device_port},nodelay"]
        rounds, count = self.sized((2, 50), (3, 300), (21, 1000))
        # Free, a relay's figure depends on where the scheduler puts it beside its peers; on one CPU it is the work alone.
        for where, words, most in (("", [], 1.0), (", one CPU", ["--cpu", 0], None)):
            lines = {line["name"]: line for line in self.linebench(
                "rtt", *relays, "--rounds", rounds, "--count", count, "--warmup", count // 10, *words)}
            for key, title in (("p50", "median"), ("p99", "p99")):
                self.against_socat(f"TCP round trip {title}, record{where}", lines["record"], lines.get("socat"), key + "_rounds",
                                   key + "_us", "us", most=most if key == "p50" else None)
        size, rounds = self.sized((MIB, 1), (32 * MIB, 1), (128 * MIB, 7))
        lines = {(line["name"], line["direction"]): line for line in self.linebench(
            "throughput", *relays, "--tape", "record=t.log", "--bytes", size, "--rounds", rounds, "--write", 65536)}
        for direction, title in (("to_driver", "to driver"), ("to_device", "to device"), ("both", "both ways")):
            self.against_socat(f"TCP recording {title}", lines[("record", direction)], lines.get(("socat", direction)),
                               "MBps_rounds", "MBps", "MB/s", least=1.0)

    def against_socat(self, name, line, base, rounds, key, unit, **target):
        if base is None:
            return self.table.add(name, line[key], unit)
        ratio = statistics.median(a / b for a, b in zip(line[rounds], base[rounds]))
        return self.table.add(name, line[key], unit, base[key], "socat", ratio, **target)

    def channels(self):
        if not self.programs["porttaped"]:
            return self.table.skip("channels", "porttaped is not built")
        seconds = self.sized(1, 2, 10)
        # A quick run is also one of a slow build beside much else: no recorder may be short of time there.
        rate = self.sized(0.1, 1, 1)
        done = self.linebench("channels", "--daemon", self.programs["porttaped"], "--seconds", seconds,
                              "--rate", int(rate * 1e6))[0]
        late = done["seconds"] / seconds
        self.table.add(f"64 TCP channels of {rate:g} MB/s, all bytes and tapes", done["MBps"], "MB/s", 64 * rate, "sent", 1 / late)
        self.table.add("  peak memory", done["peak_kib"] / 1024, "MiB", most=64)
        self.table.add("  CPU", done["cpu_percent"], "%")

    def ptys(self):
        if not self.programs["porttaped"]:
            return self.table.skip("ptys", "porttaped is not built")
        # Builds that are compared get what an old one can do.
        channels = self.sized(64, 64, 256)

        def run(*words):
            return self.linebench("ptys", "--channels", *words, "--talking", 64, "--seconds", self.sized(1, 3, 10))[0]

        daemon = ("--daemon", self.programs["porttaped"])
        done = run(channels, *daemon, "--idle", self.sized(0.5, 1, 3))
        self.table.add(f"{channels} serial channels, idle, wake-ups a channel", done["idle_wakeups_per_s"] / channels, "/s", most=2)
        self.table.add("  CPU", done["idle_cpu_percent"], "%")
        self.table.add("  peak memory", done["peak_kib"] / 1024, "MiB", most=64)
        for name, *how in (("spread", ), ("together", "--together")):
            done = run(64, *daemon, "--idle", 0.2, *how)
            bare = None if self.effort == "pair" else run(64, "--idle", 0.2, *how)
            self.table.add(f"64 at 115200 both ways, {name}, all bytes and tapes, CPU a piece of 64 bytes",
                           done["cpu_us_per_piece"], "us", *([bare["cpu_us_per_piece"], "bare loop",
                                                              done["cpu_us_per_piece"] / bare["cpu_us_per_piece"]] if bare else []))
            self.table.add("  CPU", done["cpu_percent"], "%", *([bare["cpu_percent"], "bare loop"] if bare else []))
            self.table.add("  wake-ups a piece", done["wakeups_per_piece"], "")

    def delivery(self):
        tape, report = self.folder / "steps.log", self.folder / "report.json"
        blocks, rounds = self.sized((100, 1), (200, 1), (400, 5))
        self.linebench("make-tape", "--tape", tape, "--blocks", blocks, "--block", 16, "--gap-min", 200, "--gap-max", 5000)
        floors, lates, own = [], [], []
        for _ in range(rounds):
            floors += self.linebench("arrivals", "--tape", tape, "--floor")
            if not self.programs["porttaped"]:
                continue
            relay = self.daemon("replay", "--tape", tape, "--timing recorded --strictness 0 --once --report", report)
            late, ended = self.linebench("arrivals", "--tape", tape, "--relay", f"replay={relay}", "--wait")
            if ended["exit"] != 0:
                raise Failed(f"porttaped replay --once ended with {ended['exit']}, expected 0")
            lates.append(late)
            own.append(json.loads(report.read_text(encoding="utf-8"))["timer_late_us"])

        def middle(lines, key):
            return statistics.median(line[key] for line in lines)

        if not lates:
            return self.table.add("delivery late, median, plain timer", middle(floors, "late_p50_us"), "us")
        self.table.add("delivery late, least of all (early if < 0)", min(line["late_min_us"] for line in lates), "us",
                       min(line["late_min_us"] for line in floors), "plain timer", least=0)
        self.table.add("delivery late, median", middle(lates, "late_p50_us"), "us", middle(floors, "late_p50_us"),
                       "plain timer", most=100)
        self.table.add("delivery late, p99", middle(lates, "late_p99_us"), "us", middle(floors, "late_p99_us"), "plain timer")
        self.table.add("  of it all blocks alike (open noticed, pty)", middle(lates, "late_min_us"), "us")
        self.table.add("daemon's own timer late, median", middle(own, "p50"), "us")
        self.table.add("daemon's own timer late, p99", middle(own, "p99"), "us")

    def verify(self):
        if not self.programs["porttape"]:
            return self.table.skip("verify", "porttape is not built")
        size, rounds = self.sized((4 * MIB, 1), (64 * MIB, 1), (256 * MIB, 5))
        tape = self.folder / "verify.log"
        self.linebench("make-tape", "--tape", tape, "--bytes", size, "--block", 64, "--both")
        files = [f"{tape}r", f"{tape}w"]
        total = sum(os.path.getsize(path) for path in files)
        speeds, floors = [], []
        for _ in range(rounds):
            floors.append(self.linebench("read", *files)[0]["GBps"])
            done = self.linebench("peak", "--", self.programs["porttape"], "verify", tape)[0]
            if done["exit"] != 0:
                raise Failed(f"porttape verify ended with {done['exit']} on a sound tape")
            speeds.append(total / 1e9 / done["seconds"])
        self.table.add("verify, 64-byte blocks, cached", statistics.median(speeds), "GB/s", statistics.median(floors),
                       "plain read", least=1)
        for path in files:
            os.unlink(path)

    def memory(self):
        if not self.programs["porttaped"] and not self.programs["porttape"]:
            return self.table.skip("memory", "porttaped and porttape are not built")
        size = 5 << 30 if self.effort == "full" else self.sized(4 * MIB, 64 * MIB, 256 * MIB)
        tape = self.folder / "big.log"
        free = shutil.disk_usage(self.folder).free
        if free < 1.2 * size + (1 << 30):
            return self.table.skip("memory", f"{free >> 20} MiB free in --dir are too few")
        payload = size * 64 // 76
        self.linebench("make-tape", "--tape", tape, "--bytes", payload, "--block", 64)
        if self.programs["porttape"]:
            done = self.linebench("peak", "--", self.programs["porttape"], "verify", tape)[0]
            if done["exit"] != 0:
                raise Failed(f"porttape verify ended with {done['exit']} on a sound tape")
            self.table.add(f"peak memory, verify of {size / MIB:g} MiB", done["peak_kib"] / 1024, "MiB", most=16)
        if self.programs["porttaped"]:
            relay = self.daemon("replay", "--tape", tape, "--timing none --strictness 0")
            done = self.linebench("sink", "--relay", f"replay={relay}", "--bytes", payload)[0]
            self.table.add(f"peak memory, replay of {size / MIB:g} MiB", done["relay_peak_kib"] / 1024, "MiB", most=16)
            self.table.add("replay speed, 64-byte blocks, no delays", done["MBps"], "MB/s")
        for path in self.folder.glob("big.log?"):
            path.unlink()

    def idle(self):
        if not self.programs["porttaped"]:
            return self.table.skip("idle", "porttaped is not built")
        relay = self.daemon("bridge", "--device serial:{device}")
        for line in self.linebench("idle", "--relay", f"bridge={relay}", "--seconds", self.sized(0.5, 1, 5)):
            if "ended" in line:
                raise Failed(f"porttaped bridge ended with {line['ended']}, driver's port {line['driver']}")
            self.table.add(f"idle bridge, driver's port {line['driver']}", line["cpu_percent"], "% CPU", most=0.5)
            self.table.add("  its wake-ups", line["wakeups_per_s"], "/s")

    def start(self):
        """What `porttape test` adds to the command it runs."""
        if not self.programs["porttape"]:
            return self.table.skip("start", "porttape is not built")
        tape = self.folder / "start.log"
        self.linebench("make-tape", "--tape", tape, "--blocks", 2, "--block", 16, "--gap-min", 200, "--gap-max", 300)
        alone, tested = [], []
        command = [shutil.which("true")]
        for _ in range(self.sized(5, 11, 101)):
            alone.append(seconds_of(command))
            tested.append(seconds_of([str(self.programs["porttape"]), "test", "--tape", str(tape), "--", *command]))
        beyond = statistics.median(tested) - statistics.median(alone)
        self.table.add("test of nothing, beyond its command", beyond * 1e3, "ms", statistics.median(alone) * 1e3, "the command",
                       most=5)

    def exec(self):
        """What a driver has of the supervisor of `porttape exec`: its round trips beside those of a recorded line, those that are
        tapped and its calls beside those on a bare pty."""
        porttape, porttaped = self.programs["porttape"], self.programs["porttaped"]
        if not porttape or not porttaped:
            return self.table.skip("exec", "porttape or porttaped is not built")
        probe = subprocess.run([str(porttape), "probe", "--", shutil.which("true")], capture_output=True, text=True, check=False)
        if probe.returncode != 0:
            return self.table.skip("exec", (probe.stderr.strip().splitlines() or ["porttape probe fails"])[-1])
        line = "--device serial:{device} --driver pty:{driver} --tape {dir}/t.log --overwrite"
        driven = f"exec={porttape} exec {line} -- {self.programs['linebench']} drive {{port}} {{dir}}"
        rounds, count = self.sized((2, 50), (3, 300), (21, 600))
        lines = {line["name"]: line for line in self.linebench(
            "rtt", "--relay", f"record={porttaped} record {line} --log-level warn", "--driven", driven, "--rounds", rounds,
            "--count", count, "--warmup", count // 10)}
        record, driver = lines["record"], lines["exec"]
        for key, title in (("p50", "median"), ("p99", "p99")):
            without, under = record[key + "_rounds"], driver[key + "_rounds"]
            # Within the spread of a line that is only recorded: the upper end of the middle half of its rounds.
            spread = max(1.02, statistics.quantiles(without, n=4)[2] / statistics.median(without))
            self.table.add(f"round trip {title}, under exec", driver[key + "_us"], "us", record[key + "_us"], "record",
                           statistics.median(a / b for a, b in zip(under, without)), most=spread if key == "p50" else None)
        tap = f"tap={porttape} exec --tap --tape {{dir}}/t.log -- {self.programs['linebench']} drive {{device}} {{dir}}"
        lines = {line["name"]: line for line in self.linebench(
            "rtt", "--relay", "bare=", "--driven", tap, "--rounds", rounds, "--count", 4 * count, "--warmup", count // 10)}
        beyond = statistics.median(a - b for a, b in zip(lines["tap"]["p50_rounds"], lines["bare"]["p50_rounds"]))
        self.table.add("round trip median, exec --tap, beyond bare", beyond, "us", lines["bare"]["p50_us"], "bare pty", most=15)
        rounds, count = self.sized((2, 50), (3, 300), (11, 2000))
        for call in self.linebench("calls", "--driven", driven, "--rounds", rounds, "--count", count):
            name, value, bare = call["call"], call["p50_us"], call["bare_p50_us"]
            if call["trapped"]:
                self.table.add(f"{name} under exec, median", value, "us", bare, "bare pty",
                               most=trapped_limit() if name == "TIOCMGET" else None)
            else:
                self.table.add(f"{name} under exec, not trapped, beyond bare", max(value - bare, 0), "us", bare, "bare pty", most=0.3)


def trapped_limit():
    """Microseconds. Linux 6.6 and newer wake both sides of a trapped call at once."""
    version = [int(number) for number in re.findall(r"\d+", platform.release())[:2]]
    return 12 if version >= [6, 6] else 20


def seconds_of(command):
    """From the start of a program to its end; what it says and gives does not matter."""
    with open(os.devnull, "r+b") as null:
        files = [(os.POSIX_SPAWN_DUP2, null.fileno(), number) for number in range(3)]
        begin = time.perf_counter()
        child = os.posix_spawn(command[0], command, os.environ, file_actions=files)
        os.waitpid(child, 0)
        return time.perf_counter() - begin
