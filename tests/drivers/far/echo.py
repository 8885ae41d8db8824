"""A device that sends back what it gets."""

from far.quiet import Quiet


class Echo(Quiet):
    def received(self, line, data):
        line.send(data)
