"""The helper for bounds of time, for test programs in Python; tests/README.md has the rule.

`late` ends a test whose only fault is that something took too long, with a status that makes ./check run it once more.
Bytes that do not come are lost bytes however long they were waited for: never end with this for them."""

import os
import sys

BOUND_OF_TIME = 75  # the exit status; EX_TEMPFAIL
MARK = "bound of time: "  # begins what such a test says
MOST_UNSTABLE = 3  # more of them are red


def late(text):
    name = os.path.splitext(os.path.basename(sys.argv[0]))[0]
    print(f"{name}: {MARK}{text}", file=sys.stderr, flush=True)
    sys.exit(BOUND_OF_TIME)


def within(elapsed, bound, what):
    """Seconds. What took longer than its bound ends the test."""
    if elapsed > bound:
        late(f"{what}: {elapsed:.3f} s, over {bound} s")
