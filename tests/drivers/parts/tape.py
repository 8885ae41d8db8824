"""A tape, as far as it is compared with what the far end saw."""

import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "devices"))

import tapefile  # noqa: E402
from far.end import Held, Settings  # noqa: E402


class Tape:
    def __init__(self, name):
        self.written = tapefile.payload(f"{name}.logw")
        self.read = tapefile.payload(f"{name}.logr")
        self._written = [(at, len(data)) for at, data in tapefile.blocks(f"{name}.logw")]
        lines = pathlib.Path(f"{name}.loge").read_text().splitlines()
        self.events = [event for event in map(json.loads, lines) if "event" in event]

    def count(self, kind):
        return sum(event["event"] == kind for event in self.events)

    def sessions(self):
        """The driver's settings, from each open to its close, as a FarEnd keeps them: [[Held, …], …]."""
        found = []
        for event in self.events:
            if event["event"] == "open":
                found.append([])
            elif event["event"] == "settings" and event.get("by") == "driver" and found:
                found[-1].append(self._held(event, Settings(event.get("baud"), event.get("stopbits", 1),
                                                            bool(event.get("hwflowctrl")),
                                                            bool(event.get("swflowctrl")))))
            elif event["event"] == "close" and found:
                found[-1].append(self._held(event, None))
        return found

    def _held(self, event, settings):
        return Held(settings, event["t_us"] / 1e6, sum(size for at, size in self._written if at < event["t_us"]))
