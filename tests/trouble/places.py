"""The calls to the system that a program makes: where, how often, and what may go wrong with each."""

import collections
import dataclasses
import errno
import functools
import os
import struct
import subprocess

TABLE_SIZE = 4096 * 64  # fail_calls.cpp: kPlaces entries
ENTRY = struct.Struct("<II32sQQQ")
FOR_EVER = 10**9

Site = collections.namedtuple("Site", "kind address calls troubled")


def read_table(path):
    """What fail_calls.cpp noted: [Site]."""
    with open(path, "rb") as file:
        data = file.read()
    return [Site(kind.rstrip(b"\0").decode(), address, calls, troubled)
            for state, _, kind, address, calls, troubled in ENTRY.iter_unpack(data) if state == 2]


class Names:
    """The addresses of one program as places in its source, "libport/loop/outbox.cpp:60"; as they are where that is not known."""

    def __init__(self, program, source):
        self.program, self.source, self.known = program, os.path.realpath(source), {}

    def in_source(self, path):
        """The path within the source; None: it is not of it. A compiler's cache may name another copy of the tree."""
        parts = os.path.normpath(path).split("/")
        names = ("/".join(parts[i:]) for i in range(1, len(parts)))
        return next((name for name in names if "/" in name and os.path.exists(os.path.join(self.source, name))), None)

    def learn(self, addresses):
        unknown = sorted(set(addresses) - set(self.known))
        for address in unknown:
            self.known[address] = f"{address:#x}"
        if not unknown:
            return
        # An address is behind its call; -i: out of which inlined functions it came, the innermost first.
        command = ["addr2line", "-a", "-i", "-e", self.program] + [f"{address - 1:#x}" for address in unknown]
        try:
            lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
        except (OSError, subprocess.CalledProcessError):
            return
        address, found = 0, False
        for line in lines:
            if line.startswith("0x"):
                address, found = int(line, 16) + 1, False
                continue
            file, _, number = line.partition(":")
            if self.known[address].startswith("0x") and not file.startswith("?"):
                self.known[address] = f"{os.path.basename(file)}:{number.split()[0]}"
            if not found and not file.startswith("/usr/") and (inner := self.in_source(file)):
                self.known[address] = f"{inner}:{number.split()[0]}"
                found = True

    def name(self, address):
        return self.known.get(address, f"{address:#x}")

    def places(self, sites):
        """{place: ([address], calls)} with places as "KIND@WHERE"."""
        self.learn(site.address for site in sites)
        found = {}
        for site in sites:
            addresses, calls = found.get(f"{site.kind}@{self.name(site.address)}", ([], 0))
            found[f"{site.kind}@{self.name(site.address)}"] = (addresses + [site.address], calls + site.calls)
        return found


@dataclasses.dataclass(frozen=True)
class Trouble:
    """One thing that goes wrong: `action` (see fail_calls.cpp) from the `first` call of the place on, `count` times."""
    place: str
    first: int
    count: int
    action: str
    number: int = 0

    def __str__(self):
        number = errno.errorcode[self.number] if self.action == "errno" else str(self.number)
        often = "ever" if self.count == FOR_EVER else str(self.count)
        return f"{self.place} {self.first} {often} {self.action} {number}"

    @staticmethod
    def parse(text):
        place, first, often, action, number = text.split()
        return Trouble(place, int(first), FOR_EVER if often == "ever" else int(often), action,
                       getattr(errno, number) if action == "errno" else int(number))

    @property
    def kind(self):
        return self.place.split("@")[0]

    @property
    def harmless(self):
        """Whether nobody may notice anything: the call is to be made again, or gave less than it could."""
        return (self.action in ("short", "clock") or self.count < FOR_EVER and
                self.action == "errno" and self.number in WAITS and self.kind not in MUST_SUCCEED)

    def environment(self, addresses):
        sites = ",".join(f"{address:x}" for address in addresses) or "*"
        return f"{self.kind} {sites} {self.first} {self.count} {self.action} {self.number}"


WAITS = {errno.EINTR, errno.EAGAIN}

# EAGAIN of these says that there is no room, or no lock.
MUST_SUCCEED = {"fork", "pthread_create", "flock.file", "flock.slave", "fcntl.37", "connect", "getaddrinfo"}

# What the kernel really gives (man 2, and the sources of ttys and sockets), by kind or by function. A tuple: an action.
SHORT = ("short", 0)
ERRORS = {
    "read.master": ["EINTR", "EAGAIN", SHORT],
    "read.slave": ["EIO", "EINTR", "EAGAIN", SHORT],
    "read.file": ["EIO", SHORT],
    "read.anonymous": ["EINTR"],
    "read.pipe": [],  # a signal's, which nothing else touches
    "write.pipe": [],
    "read": ["EINTR"],
    "pread": ["EIO", SHORT],
    "write.master": ["ENOMEM", "EINTR", "EAGAIN", SHORT],
    "write.slave": ["EIO", "EINTR", "EAGAIN", SHORT],
    "write.file": ["ENOSPC", "EIO", "EINTR", SHORT],
    "write.anonymous": ["EINTR"],
    "write": ["EIO", "EINTR", SHORT],
    "pwrite": ["ENOSPC", SHORT],
    "writev": ["ENOSPC", "EIO", "EDQUOT", "EINTR", SHORT],
    "recv": ["ECONNRESET", "ETIMEDOUT", "EINTR", "EAGAIN", SHORT],
    "recvfrom": ["ECONNREFUSED", "EINTR", "EAGAIN"],
    "recvmsg": ["ECONNREFUSED", "ENOMEM", "EINTR", "EAGAIN"],
    "send": ["EPIPE", "ECONNRESET", "EINTR", "EAGAIN", SHORT],
    "sendto": ["ENOBUFS", "ECONNREFUSED", "EINTR"],
    "sendmsg": ["ENOBUFS", "EINTR"],
    "open": ["EMFILE", "EACCES"],
    "openat": ["ENOSPC", "EMFILE", "EACCES"],
    "close": ["EIO"],
    "dup": ["EMFILE"],
    "dup2": ["EBUSY"],
    "pipe": ["EMFILE"],
    "pipe2": ["ENFILE"],
    "fsync": ["EIO", "ENOSPC"],
    "fdatasync": ["EIO", "ENOSPC", "EDQUOT"],
    "ftruncate": ["EIO", "EPERM"],
    "fstat": ["EIO"],
    "stat": ["EACCES", "EIO"],
    "lstat": ["EACCES", "EIO"],
    "fstatat": ["EACCES", "EIO"],
    "statfs": ["EIO"],
    "flock": ["ENOLCK", "EWOULDBLOCK"],
    "fcntl.37": ["ENOLCK"],  # F_OFD_SETLK
    "fcntl.1030": ["EMFILE"],  # F_DUPFD_CLOEXEC
    "fcntl": [],  # flags of a descriptor that is there: cannot fail
    "ioctl.FIONBIO": [],
    "timerfd_settime": [],
    "fchmod": ["EPERM"],
    "chmod": ["EPERM", "EROFS"],
    "chown": ["EPERM"],
    "access": ["EACCES"],
    "faccessat": ["EACCES"],
    "rename": ["ENOSPC", "EACCES"],
    "renameat": ["ENOSPC", "EACCES"],
    "link": ["EPERM", "ENOSPC"],
    "symlink": ["ENOSPC", "EACCES"],
    "readlink": ["EACCES"],
    "unlink": ["EACCES", "EROFS"],
    "unlinkat": ["EACCES"],
    "mkdir": ["ENOSPC", "EACCES"],
    "utimensat": ["EPERM"],
    "tcflush": ["EIO"],
    "isatty": ["ENOTTY"],
    "ioctl": ["EIO"],
    "ioctl.TIOCMBIS": ["EINVAL", "EIO"],
    "posix_openpt": ["ENOSPC", "EMFILE", "ENOENT"],
    "grantpt": ["EACCES"],
    "unlockpt": ["EIO"],
    "ptsname_r": ["ENOTTY"],
    "socket": ["EMFILE", "EAFNOSUPPORT", "ENOBUFS"],
    "bind": ["EADDRINUSE", "EACCES"],
    "listen": ["EADDRINUSE"],
    "accept4": ["EMFILE", "ECONNABORTED", "EINTR", "EAGAIN"],
    "connect": ["ECONNREFUSED", "ENETUNREACH", "EAGAIN"],
    "shutdown": ["ENOTCONN"],
    "getsockname": [],  # of a socket that is there
    "getpeername": ["ENOTCONN"],
    "getsockopt": ["ENOBUFS"],
    "setsockopt": ["ENOMEM"],
    "getaddrinfo": ["EAGAIN"],
    "epoll_create1": ["EMFILE"],
    "epoll_ctl.add": ["ENOSPC", "ENOMEM"],
    "epoll_ctl": [],  # of what is there
    "epoll_wait": ["EINTR"],
    "eventfd": ["EMFILE"],
    "timerfd_create": ["EMFILE"],
    "poll": ["EINTR"],
    "inotify_init1": ["EMFILE"],
    "inotify_add_watch": ["ENOSPC", "ENOMEM"],
    "inotify_rm_watch": ["EINVAL"],
    "fork": ["EAGAIN"],
    "waitpid": ["EINTR"],
    "pthread_create": ["EAGAIN"],
    "getrlimit": ["EINVAL"],
    "setrlimit": ["EPERM"],
    "getrusage": ["EINVAL"],
    "gethostname": ["ENAMETOOLONG"],
    "getrandom": ["EINTR"],
    "clock_gettime": [("clock", 86400), ("clock", -86400 * 365)],
    "new": ["ENOMEM"],
}

# Where one failure that stays says more than many that pass.
STAYS = {"ENOSPC", "EIO", "EDQUOT", "EMFILE", "ENFILE", "EACCES", "EPERM", "EROFS", "ENOMEM", "EAFNOSUPPORT", "ENOLCK",
         "ECONNREFUSED", "ENETUNREACH", "EADDRINUSE", "ENOTTY"}


# Where a failure is left alone, and why.
LEFT_ALONE = {
    "epoll_ctl.add@epoll_reactor.ipp:54": "Asio does not tell that its wake-up is not watched",
    "epoll_ctl.add@epoll_reactor.ipp:62": "Asio does not tell that its timer is not watched",
}


@functools.cache
def errors_of(kind):
    for name in (kind, kind.split(".")[0]):
        if name in ERRORS:
            return ERRORS[name]
    return ["EIO"]


def nth(calls, most):
    """Every N up to the number of calls; where that is more than `most`, the first ones and then fewer and fewer."""
    if calls <= most:
        return list(range(1, calls + 1))
    wanted = list(range(1, most // 2 + 1))
    step = (calls / wanted[-1]) ** (1 / (most - len(wanted)))
    return sorted(set(wanted) | {round(wanted[-1] * step ** i) for i in range(1, most - len(wanted) + 1)})


def troubles_of(place, calls, most):
    """Everything that can go wrong at a place: for every N, once and, from the first and the middle one on, for ever."""
    kind = place.split("@")[0]
    found = []
    if place in LEFT_ALONE:
        return found
    for error in errors_of(kind):
        action, number = error if isinstance(error, tuple) else ("errno", getattr(errno, error))
        found += [Trouble(place, first, 1, action, number) for first in nth(calls, most)]
        if error in STAYS and not kind.startswith(("close", "write.master", "recv")):
            found += [Trouble(place, first, FOR_EVER, action, number) for first in sorted({1, (calls + 1) // 2})]
        if action == "short":
            found.append(Trouble(place, 1, FOR_EVER, action, number))
    return found
