"""`stiction study flags`: after a wrong flag no answer may be confident and wrong; here they are counted."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from stiction.core.errors import FileError, StictionError
from stiction.core.records import column
from stiction.studies.study import Options, Report, Study, Work

if TYPE_CHECKING:
    from stiction.studies.flags.cases import Case

DESCRIPTION = (
    "Make ten kinds of mistakes that people make on three records each, measured ones (STICTION_DATA) and simulated "
    "joints of known friction, and count which of them end with a friction that is stated, wrong, and not objected to."
)

TOLERANCE = 0.1
"""Relative error of the friction that is wrong, if the interval does not hold the right one either."""


@dataclass(frozen=True, kw_only=True)
class FlagsOptions(Options):
    """Options of `stiction study flags`."""

    out: Path = Path("stiction-flags")
    """Directory for flags.csv, summary.json and report.html."""


@dataclass(frozen=True)
class Outcome:
    """What identification said after a mistake."""

    mistake: str = field(metadata=column("mistake"))
    """What was done wrong."""
    record: str = field(metadata=column("record"))
    """To which record."""
    right: float = field(metadata=column("right", "N m", ".4g"))
    """Dry friction with the right flags [N m, or N]."""
    found: float | None = field(metadata=column("found", "N m", ".4g"))
    """Dry friction that came out; None where the log was refused [N m, or N]."""
    low: float | None = field(metadata=column("from", "N m", ".4g"))
    """Lower end of its interval."""
    high: float | None = field(metadata=column("to", "N m", ".4g"))
    """Upper end."""
    caught: str = field(metadata=column("caught by"))
    """`refused`, or the reasons of the objections; empty where the friction is stated."""
    said: str = field(metadata=column("in words"))
    """The refusal, or the first objection, or the first line of the verdict and the first warning."""
    invisible: str = field(metadata=column("why it does not show"))
    """Why the mistake does not show; empty where it does."""

    @property
    def wrong(self) -> bool:
        """Whether what came out is not the right friction."""
        if self.found is None or self.low is None or self.high is None:
            return False
        return abs(self.found / self.right - 1) > TOLERANCE and not self.low <= self.right <= self.high

    @property
    def confident(self) -> bool:
        """Whether it is stated, wrong, and not objected to."""
        return self.wrong and not self.caught


def outcome(case: Case) -> Outcome:
    """Identify a record after a mistake."""
    from stiction.identify.pipeline import identify_joint

    given = case.given()
    try:
        record = identify_joint(given.log, setup=given.setup).record
    except StictionError as error:
        nothing = (None, None, None)
        return Outcome(case.mistake, case.record, given.friction, *nothing, "refused", str(error), case.invisible)
    friction = record.coulomb_friction or record.combinations["f/k"]
    reasons = ", ".join(dict.fromkeys(one.reason for one in record.objections))
    stated = " ".join((record.diagnostics["verdict"]["lines"][0], *record.warnings[:1]))
    said = record.objections[0].seen if record.objections else stated
    numbers = (friction.value, *friction.interval95)
    return Outcome(case.mistake, case.record, given.friction, *numbers, reasons, said, case.invisible)


def lead(rows: Sequence[Outcome]) -> str:
    """Count what became of the cases."""
    caught, wrong = [row for row in rows if row.caught], [row for row in rows if row.confident]
    right, hidden = len(rows) - len(caught) - len(wrong), sum(bool(row.invisible) for row in wrong)
    refused = sum(row.caught == "refused" for row in caught)
    return (
        f"{len(rows)} cases: {len(caught)} caught ({refused} refused, {len(caught) - refused} not valid), "
        f"{right} stated and right all the same, {len(wrong)} stated and wrong, {hidden} of these by a mistake that is "
        "known not to show."
    )


def run(options: FlagsOptions, work: Work) -> Report:
    """Make every mistake."""
    from stiction.studies.flags.cases import cases

    folder = os.environ.get("STICTION_DATA")
    if not folder:
        raise FileError("STICTION_DATA names no folder; expected one with the measured records emps and go2")
    work.begin()
    todo = cases(Path(folder))
    rows = []
    for number, case in enumerate(todo):
        work.progress(f"{case.mistake}: {case.record}", number / len(todo))
        rows.append(outcome(case))
    answer = lead(rows)
    return Report(
        title="After a wrong flag",
        lead=answer,
        tables={"flags": rows},
        summary={"lead": answer, "seconds": work.seconds},
        status=1 if any(row.confident and not row.invisible for row in rows) else 0,
    )


STUDY = Study("is any answer confident and wrong after a wrong flag", DESCRIPTION, FlagsOptions, run)
