"""What most devices have in common."""


class Quiet:
    """A device that only answers. It speaks at one rate; what it hears at another is not for it."""

    def __init__(self, rate):
        self.rate = rate

    def opened(self, line):
        pass

    def closed(self):
        pass

    def due(self):
        return None

    def tick(self, line):
        pass

    def end(self):
        pass
