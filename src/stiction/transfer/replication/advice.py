"""What the comparison says on which training to choose, for `stiction identify`: other engines, virtual robots."""

from __future__ import annotations

from stiction.formats.advice import Source, Way
from stiction.formats.replication import Replication


def source_of(result: Replication) -> Source:
    """Return who follows under shares of the torque limit, where a user's robot may be."""
    ways: dict[str, Way] = {}
    for policy in result.summary["policies"].values():
        level = 0.0 if policy["method"] == "none" else policy["friction_level"]
        low, high = (round(end / level, 6) if level else 0.0 for end in policy["friction_range"])
        ways.setdefault(policy["way"], Way(policy["method"], level, low, high))
    summary = result.summary
    return Source(summary["command"], summary["revision"], tuple(sorted(summary["policies"])), ways, result.needs)
