"""The bell by which a thread says that something has come."""

import select

from stiction.deploy.transports.link import Bell


def test_nobody_waits_for_a_bell_that_nobody_hears() -> None:
    """A thread that waited in it could not be joined: a run that looks elsewhere for a while would never end."""
    bell = Bell()
    for _ in range(100_000):
        bell.ring()
    assert select.select([bell], [], [], 0.0)[0]
    bell.silence()
    assert not select.select([bell], [], [], 0.0)[0]
    bell.close()
