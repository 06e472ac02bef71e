"""Words of a command line in which some say something else: an option may not be given twice."""

from __future__ import annotations

from collections.abc import Sequence


def but(words: Sequence[str], *own: str) -> list[str]:
    """Return `words`, less the options that `own` gives, and then `own`."""
    mine = {word.partition("=")[0] for word in own if word.startswith("--")}
    kept: list[str] = []
    keeps = True
    for word in words:
        if word.startswith("--"):
            keeps = word.partition("=")[0] not in mine
        if keeps:
            kept.append(word)
    return [*kept, *own]
