"""Sequences of line settings, made comparable."""

# What was held for less than that, and while the driver wrote less than so many bytes, need not be seen by one who looks
# at times.
SHORTEST_SECONDS = 0.03
FEWEST_BYTES = 8
# What a driver leaves behind when it closes is held until the close is noticed, on a busy machine late.
SHORTEST_LAST_SECONDS = 0.3


def held(sessions):
    """What a FarEnd or a tape kept as [[Settings, …], …], without what nobody could have noticed."""
    found = []
    for history in sessions:
        found.append([])
        for now, then in zip(history, history[1:]):
            shortest = SHORTEST_SECONDS if then.settings else SHORTEST_LAST_SECONDS
            if then.since - now.since >= shortest or then.written - now.written >= FEWEST_BYTES:
                found[-1].append(now.settings)
    return found


def made_by_driver(sessions, own):
    """One sequence of what the driver made different from the line's own settings.

    The line's own at the beginning and the end of a session are not the driver's doing: a daemon gives them back at the
    end, where a driver that opens the line itself leaves what it made, and meets it when it opens again.
    """
    sequence = []
    for session in sessions:
        made = list(session)
        while made and made[0] == own:
            del made[0]
        while made and made[-1] == own:
            del made[-1]
        sequence += made
    return [now for at, now in enumerate(sequence) if at == 0 or sequence[at - 1] != now]


def text(sequence):
    return ", ".join(map(str, sequence)) or "no other than its own"
