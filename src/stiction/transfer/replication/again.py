"""Judges a comparison anew from its summary.json: the same rows under today's criteria, and nothing walks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stiction.formats.errors import StictionError
from stiction.formats.experiment import Verdict, changed_verdicts
from stiction.formats.replication import SUMMARY, PartRecord, Replication
from stiction.formats.results import COLUMNS, ResultRow, read_summary
from stiction.robots.catalog import find_robot
from stiction.transfer.replication.run import judged


def judge_again(out: Path, made: dict[str, Any]) -> Replication:
    """Return the comparison that a folder has, judged anew; its summary says so, and which verdicts changed.

    made: by what it is judged now: the command, and what `Origin` says.

    Raises:
        StictionError: the folder has no summary of a comparison.

    """
    before = read_summary(out / SUMMARY)
    try:
        records = [_record(name, part, before["grids"][name]) for name, part in before["parts"].items()]
        verdicts = [Verdict(**one) for one in before["verdicts"]]
        (robot,) = {policy["robot"] for policy in before["policies"].values()}
    except (KeyError, TypeError, ValueError) as error:
        raise StictionError(
            f"{out / SUMMARY} is no summary of `stiction replicate` ({error!r}); expected one that it wrote"
        ) from error
    own = ("schema_version", "ways", "verdicts", "parts")
    kept = {name: value for name, value in before.items() if name not in own}
    found = judged(records, find_robot(robot), kept | {"judged": made})
    found.summary["changed"] = changed_verdicts(verdicts, found.verdicts, before.get("changed", []))
    return found


def _record(name: str, part: dict[str, Any], grid: dict[str, Any]) -> PartRecord:
    """Return one part as it was walked."""
    rows = [ResultRow(**{column: row[column] for column in COLUMNS}) for row in part["rows"]]
    return PartRecord(name, part["title"], rows, part["rows"], grid.get("kept", ""), grid.get("warnings", ()))
