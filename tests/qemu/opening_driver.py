"""opening_driver.py PORT MARK HOW: opens PORT as one that waits for its carrier, and says what came of it.

HOW: `opens`, no more; `waits` until it is open, and says a line; `breaks` off, by a signal without SA_RESTART; `restarts`, by signals
with it, then as `waits`. MARK is a file that it makes when the carrier may come, MARK.carrier there when it has.
"""

import ctypes
import errno
import os
import pathlib
import signal
import sys
import time

from driver import Port

LIBC = ctypes.CDLL(None, use_errno=True)


class OpenPort(Port):
    def __init__(self, fd):  # pylint: disable=super-init-not-called
        self.fd = fd


def main(path, mark, how):
    alarms = []
    signal.signal(signal.SIGALRM, lambda *_: alarms.append(1))
    signal.siginterrupt(signal.SIGALRM, how == "breaks")
    if how == "waits":
        pathlib.Path(mark).touch()
    elif how != "opens":
        # Again and again: the first may come before the open. The far end's carrier comes behind the third.
        signal.setitimer(signal.ITIMER_REAL, 0.5, 0.5)
    if how == "restarts" and os.fork() == 0:
        time.sleep(2.2)
        pathlib.Path(mark).touch()
        os._exit(0)
    fd = LIBC.open(path.encode(), os.O_RDWR | os.O_NOCTTY)
    error = ctypes.get_errno()
    signal.setitimer(signal.ITIMER_REAL, 0)
    if fd < 0:
        print("open:", errno.errorcode[error], flush=True)
        return
    print("open:", "with the carrier" if os.path.exists(f"{mark}.carrier") else "at once", flush=True)
    if how == "opens":
        return
    port = OpenPort(fd)
    port.exchange(b"Here", 120)
    print("answered", flush=True)
    port.close()


if __name__ == "__main__":
    sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
    main(*sys.argv[1:])
