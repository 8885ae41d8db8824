"""The programs that the drivers are: whether they are there, installing them, running them within a time."""

import ctypes
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time

from far import partner
from parts.case import ROOT, NodeModule, Unpacked

PR_SET_CHILD_SUBREAPER = 36


def installed(package):
    status = subprocess.run(["dpkg-query", "-W", "-f", "${db:Status-Status}", package], capture_output=True, text=True)
    return status.stdout == "installed"


def version_of(package):
    return subprocess.run(["dpkg-query", "-W", "-f", "${Version}", package], capture_output=True, text=True).stdout


def missing(case):
    return ([package for package in case.packages if not installed(package)]
            + [file.package for file in case.unpacked if not file.path()])


def install(cases):
    """Whether all that these cases need is there now. No service of theirs is started."""
    packages = sorted({package for case in cases for package in case.packages})
    script = 'source "$1/.ci/packages.sh"; shift; need_packages "$@"'
    if subprocess.run(["bash", "-c", script, "bash", str(ROOT), *packages]).returncode:
        return False
    return all(file.path() or unpack(file) for case in cases for file in case.unpacked)


def install_module(module):
    Unpacked.FOLDER.mkdir(parents=True, exist_ok=True)
    command = ["npm", "install", "--no-audit", "--no-fund", "--silent", f"{module.package}@{module.version}"]
    try:
        subprocess.run(command, cwd=Unpacked.FOLDER, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    except FileNotFoundError:
        print(f"there is no npm to install {module.package} with", file=sys.stderr)
    return module.path() is not None


def unpack(file):
    if isinstance(file, NodeModule):
        return install_module(file)
    with tempfile.TemporaryDirectory() as folder:
        if subprocess.run(["apt-get", "-o", "APT::Sandbox::User=root", "-qq", "download", file.package], cwd=folder).returncode:
            return False
        file.FOLDER.mkdir(parents=True, exist_ok=True)
        for package in pathlib.Path(folder).glob("*.deb"):
            subprocess.run(["dpkg", "-x", package, file.FOLDER], check=True)
    return file.path() is not None


def adopt_orphans():
    """From here on a process whose parent has ended is a child of this one: none is lost sight of."""
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def descendants(ancestors):
    """The living processes whose line of parents leads to one of these: [pid]."""
    parents, found = {}, []
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                fields = pathlib.Path(f"/proc/{entry}/stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if fields[0] != "Z":
                parents[int(entry)] = int(fields[1])
    for pid in parents:
        parent = pid
        while parent in parents and parent not in ancestors:
            parent = parents[parent]
        if parent in ancestors and pid not in ancestors:
            found.append(pid)
    return found


class Finished:
    def __init__(self, status, said, seconds):
        self.status, self.said, self.seconds = status, said, seconds


def run(command, limit, log, environment):
    """Runs it to its end, its words going to `log`. Where it takes longer than `limit` seconds, it is ended, status None.

    What it leaves running is ended, too, and named in what was said. Of the processes of this program only those in
    `far.partner.running` are let live: they are the device's.
    """
    before = set(descendants({os.getpid()}))
    began = time.monotonic()
    with open(log, "wb") as said:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=said, stderr=subprocess.STDOUT,
                                   env={**os.environ, **environment}, start_new_session=True)
        try:
            status = process.wait(limit)
        except subprocess.TimeoutExpired:
            status = None
        finally:
            if process.returncode is None:
                end({process.pid, *descendants({process.pid})})
    text = pathlib.Path(log).read_text(errors="replace")
    left = others(before)
    if left:
        time.sleep(0.2)  # one that is just ending needs no end
        left = others(before)
        text += "".join(f"\nleft running: {command_of(pid)}" for pid in left)
        end(left)
    return Finished(status, text.strip(), time.monotonic() - began)


def others(before):
    mine = set(partner.running)
    return set(descendants({os.getpid()})) - before - mine - set(descendants(mine))


def command_of(pid):
    try:
        return pathlib.Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
    except OSError:
        return f"pid {pid}"


def end(pids):
    for number, patience in ((signal.SIGTERM, 3), (signal.SIGKILL, 3)):
        for pid in pids:
            try:
                os.kill(pid, number)
            except ProcessLookupError:
                pass
        deadline = time.monotonic() + patience
        while any(alive(pid) for pid in pids) and time.monotonic() < deadline:
            time.sleep(0.02)
    for pid in pids:
        try:
            os.waitpid(pid, os.WNOHANG)
        except ChildProcessError:
            pass


def alive(pid):
    try:
        return pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
