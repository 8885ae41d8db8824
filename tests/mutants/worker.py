#!/usr/bin/python3
"""Runs tests for tests/mutants/run where a mutant can do little harm. It reads one JSON object a line and answers each.

A mutant may remove the wrong file, fill a disk or leave processes running. So this program, as root, is process 1 of a
process namespace of its own, in a mount namespace where everything is read-only but fresh memory file systems on /tmp,
/var/tmp, /dev/shm, /run and /run/lock, and in a network namespace with nothing but a loopback device. After each test it ends
every process of its namespace. Without the right to do that it is a subreaper and ends its own descendants; the tests
write to a folder of their own below $TMPDIR then."""

import ctypes
import fcntl
import json
import os
import resource
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time

MEMORY = 4 << 30  # bytes of address space for each process of a test
FRESH = ("/tmp", "/var/tmp", "/dev/shm", "/run", "/run/lock")  # in the order in which they are mounted
TAIL = 64 << 10  # bytes of a test's output that are kept
PR_SET_CHILD_SUBREAPER = 36


def mount(*arguments):
    subprocess.run(["mount", *arguments], check=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)


def mounted():
    with open("/proc/self/mountinfo", encoding="utf-8") as file:
        return [line.split()[4].encode().decode("unicode_escape") for line in file]


def enter_private_world(keep):
    """The mounts of this namespace, in which the folders of `keep` stay visible, read-only."""
    mount("-t", "tmpfs", "porttape-mutants", "/mnt")  # holds what a new /tmp would hide
    held = [folder for folder in keep if folder.startswith(FRESH)]
    for number, folder in enumerate(held):
        os.mkdir(f"/mnt/{number}")
        mount("--bind", folder, f"/mnt/{number}")
    os.mkdir("/mnt/run")
    mount("--rbind", "/run", "/mnt/run")
    for folder in FRESH:
        if os.path.isdir(folder):
            mount("-t", "tmpfs", "-o", f"size=1g,mode={'0755' if folder == '/run' else '1777'}", "porttape-mutants", folder)
        if folder == "/run":  # a daemon's control socket is made there; what other programs have there stays visible
            for entry in os.scandir("/mnt/run"):
                if entry.is_dir(follow_symlinks=False) and entry.name != "porttape":
                    os.makedirs(f"/run/{entry.name}", exist_ok=True)
                    mount("--rbind", entry.path, f"/run/{entry.name}")
    for number, folder in enumerate(held):
        os.makedirs(folder, exist_ok=True)
        mount("--bind", f"/mnt/{number}", folder)
        mount("-o", "remount,bind,ro", folder)
    subprocess.run(["umount", "--lazy", "/mnt"], check=True, stdin=subprocess.DEVNULL)
    for place in mounted():
        if place.startswith(("/proc", "/dev/pts")) or place in FRESH:
            continue
        # A few mounts of a container refuse it; then they are not ours to damage either.
        subprocess.run(["mount", "-o", "remount,bind,ro", place], check=False, stdin=subprocess.DEVNULL,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def raise_loopback():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        request = struct.pack("16sH14x", b"lo", 0x1 | 0x40)  # IFF_UP, IFF_RUNNING
        fcntl.ioctl(any_socket, 0x8914, request)  # SIOCSIFFLAGS


def descendants():
    """All processes below this one, of /proc."""
    children = {}
    for name in os.listdir("/proc"):
        if name.isdigit():
            try:
                with open(f"/proc/{name}/stat", encoding="utf-8", errors="replace") as file:
                    parent = int(file.read().rpartition(")")[2].split()[1])
            except OSError:
                continue
            children.setdefault(parent, []).append(int(name))
    found, fresh = [], [os.getpid()]
    while fresh:
        fresh = [child for parent in fresh for child in children.get(parent, [])]
        found += fresh
    return found


class Runner:
    def __init__(self, private, scratch):
        self.private, self.scratch = private, scratch
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})

    def end_all(self):
        """Ends what a test has left, and takes what has ended."""
        for _ in range(200):
            if self.private:
                assert os.getpid() == 1
                try:
                    os.kill(-1, signal.SIGKILL)  # all of this namespace but this process
                except ProcessLookupError:
                    pass
            else:
                for process in descendants():
                    try:
                        os.kill(process, signal.SIGKILL)
                    except ProcessLookupError:
                        pass
            try:
                while os.waitpid(-1, os.WNOHANG)[0] != 0:
                    pass
            except ChildProcessError:
                return
            time.sleep(0.01)

    def clean(self):
        """Empties the folders that a test writes to."""
        for folder in FRESH if self.private else (self.scratch,):
            for entry in os.scandir(folder) if os.path.isdir(folder) else ():
                path = entry.path
                if path == self.scratch or self.keeps(path):
                    continue
                if entry.is_dir(follow_symlinks=False):
                    shutil.rmtree(path, ignore_errors=True)
                else:
                    try:
                        os.unlink(path)
                    except OSError:
                        pass

    def keeps(self, path):
        return self.private and any(place == path or place.startswith(path + "/") for place in mounted())

    def start(self, order, output):
        child = os.fork()
        if child != 0:
            return child
        try:
            os.setsid()
            signal.signal(signal.SIGPIPE, signal.SIG_DFL)
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            signal.pthread_sigmask(signal.SIG_SETMASK, set())
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            if order.get("cpu"):
                resource.setrlimit(resource.RLIMIT_CPU, (order["cpu"], order["cpu"] + 5))
            nothing = os.open("/dev/null", os.O_RDONLY)
            os.dup2(nothing, 0)
            os.dup2(output, 1)
            os.dup2(output, 2)
            os.closerange(3, 256)
            os.chdir(order["cwd"])
            os.execve(order["command"][0], order["command"],
                      {**os.environ, "TMPDIR": self.scratch, "HOME": self.scratch, **order["env"]})
        finally:
            os._exit(127)

    def run(self, order):
        os.makedirs(self.scratch, exist_ok=True)
        reached = self.scratch + ".reached"
        if order["reach"]:
            with open(reached, "wb") as file:
                file.truncate(order["reach"])
            order["env"]["PORTTAPE_MUTANT_REACHED"] = reached
        output = os.memfd_create("output")
        begin = time.monotonic()
        child = self.start(order, output)
        status, late = None, False
        while status is None:
            left = begin + order["limit"] - time.monotonic()
            if left <= 0:
                late = True
                break
            signal.sigtimedwait({signal.SIGCHLD}, min(left, 1))
            try:
                while status is None:
                    ended, how = os.waitpid(-1, os.WNOHANG)
                    if ended == 0:
                        break
                    if ended == child:
                        status = os.waitstatus_to_exitcode(how)
            except ChildProcessError:
                status = 127
        seconds = time.monotonic() - begin
        self.end_all()
        size = os.fstat(output).st_size
        text = os.pread(output, TAIL, max(0, size - TAIL)).decode("utf-8", "replace")
        os.close(output)
        numbers = []
        if order["reach"]:
            with open(reached, "rb") as file:
                numbers = [number for number, byte in enumerate(file.read()) if byte]
            os.unlink(reached)
        self.clean()
        return {"status": status, "late": late, "seconds": seconds, "output": text, "reached": numbers}


def main():
    wants_private, keep = sys.argv[1] == "private", sys.argv[2:]
    if wants_private:
        if os.getpid() != 1:
            sys.exit("worker: not in a process namespace of its own")
        enter_private_world(keep)
        raise_loopback()
        scratch = "/tmp/scratch"
    else:
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        scratch = tempfile.mkdtemp(prefix="porttape-mutants.")
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    runner = Runner(wants_private, scratch)
    print(json.dumps({"ready": True}), flush=True)
    try:
        for line in sys.stdin:
            print(json.dumps(runner.run(json.loads(line))), flush=True)
    finally:
        runner.end_all()
        if not wants_private:
            shutil.rmtree(scratch, ignore_errors=True)


if __name__ == "__main__":
    main()
