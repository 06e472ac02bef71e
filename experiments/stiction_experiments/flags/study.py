"""`stiction study flags`: after a wrong flag no answer may be confident and wrong; here they are counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from stiction.core.errors import StictionError
from stiction.core.records import column
from stiction.files.joints import FRICTION_REACHES_ZERO
from stiction_experiments.flags import RIGHT
from stiction_experiments.lab.study import Options, Report, Study, Work

if TYPE_CHECKING:
    from stiction.files.joints import Estimate, JointRecord
    from stiction_experiments.flags.cases import Case

DESCRIPTION = (
    "Make mistakes that people make, on measured records (STICTION_DATA) and on simulated joints, servos, limbs and "
    "walks of known friction, and count which of them end with a friction that is stated, wrong, and not objected to."
)

TOLERANCE = 0.1
"""Relative error of the friction that is wrong, if the interval does not hold the right one either."""


@dataclass(frozen=True, kw_only=True)
class FlagsOptions(Options):
    """Options of `stiction study flags`."""

    out: Path = Path("stiction-flags")
    """Directory for flags.csv, summary.json and report.html."""


@dataclass(frozen=True)
class MistakeRow:
    """Answer of identification after a mistake; of several joints, the worst answer."""

    mistake: str = field(metadata=column("mistake"))
    record: str = field(metadata=column("record"))
    right: float = field(metadata=column("right", "N m", ".4g"))
    """Dry friction with the right flags [N m, or N]."""
    found: float | None = field(metadata=column("found", "N m", ".4g"))
    """Dry friction that came out; None where the log was refused [N m, or N]."""
    low: float | None = field(metadata=column("from", "N m", ".4g"))
    high: float | None = field(metadata=column("to", "N m", ".4g"))
    caught: str = field(metadata=column("caught by"))
    """`refused`, or the reasons of the objections; empty where the friction is stated."""
    assumes: str = field(metadata=column("stated if"))
    """Flags that the verdict's first line names as those on which the friction rests."""
    flag: str = field(metadata=column("wrong flag"))
    """The flag that was wrong, where the mistake does not show; else empty."""
    said: str = field(metadata=column("in words"))
    """The refusal, or the first objection, or the first line of the verdict and the first warning."""
    invisible: str = field(metadata=column("why it does not show"))
    """Why the mistake does not show; empty where it does."""

    @property
    def wrong(self) -> bool:
        """Return whether the stated friction is not the right one."""
        if self.found is None or self.low is None or self.high is None:
            return False
        return abs(self.found - self.right) > TOLERANCE * self.right and not self.low <= self.right <= self.high

    @property
    def assumed(self) -> bool:
        """Return whether it is stated and wrong under the very assumption that does not hold."""
        return self.wrong and not self.caught and bool(self.flag) and self.flag in self.assumes.split()

    @property
    def confident(self) -> bool:
        """Return whether it is stated, wrong, not objected to, and not under a named assumption."""
        return self.wrong and not self.caught and not self.assumed

    @property
    def false_alarm(self) -> bool:
        """Return whether no flag was wrong and an objection or a wrong friction came all the same."""
        none = self.right == 0 and self.caught == FRICTION_REACHES_ZERO
        return self.mistake == RIGHT and (self.wrong or (bool(self.caught) and not none))


def outcome(case: Case) -> MistakeRow:
    """Identify a record after a mistake."""
    record = case.load()
    try:
        joints = record.identified()
    except StictionError as error:
        return _outcome(case, "", record.level, None, "refused", str(error))
    rows = [_joint_outcome(case, *one) for one in joints]
    return max(rows, key=lambda row: (row.confident, row.false_alarm, row.assumed, not row.caught))


def _joint_outcome(case: Case, name: str, right: float, record: JointRecord) -> MistakeRow:
    friction = record.coulomb_friction or record.combinations.get("f/k")
    if friction is None:
        return _outcome(case, name, right, None, "refused", record.warnings[0])
    reasons = ", ".join(dict.fromkeys(one.reason for one in record.objections))
    verdict = record.diagnostics["verdict"]
    stated = " ".join((verdict["lines"][0], *record.warnings[:1]))
    words = record.objections[0].seen if record.objections else stated
    return _outcome(case, name, right, friction, reasons, words, " ".join(verdict["assumes"]))


def _outcome(
    case: Case, name: str, right: float, friction: Estimate | None, caught: str, words: str, assumes: str = ""
) -> MistakeRow:
    """Return a row; friction: None where there is none."""
    value, (low, high) = (None, (None, None)) if friction is None else (friction.value, friction.interval95)
    record = f"{case.record}, {name}" if name else case.record
    return MistakeRow(case.mistake, record, right, value, low, high, caught, assumes, case.flag, words, case.invisible)


def lead(rows: Sequence[MistakeRow]) -> str:
    """Count what became of the cases."""
    right_flags, cases = [row for row in rows if row.mistake == RIGHT], [row for row in rows if row.mistake != RIGHT]
    caught, wrong = [row for row in cases if row.caught], [row for row in cases if row.confident]
    assumed = sum(row.assumed for row in cases)
    right, refused = len(cases) - len(caught) - len(wrong) - assumed, sum(row.caught == "refused" for row in caught)
    return (
        f"{len(cases)} cases: {len(caught)} caught ({refused} refused, {len(caught) - refused} not valid), "
        f"{right} stated and right all the same, {assumed} wrong and stated under the assumption that does not hold, "
        f"{len(wrong)} stated and wrong. With the right flags {sum(row.false_alarm for row in right_flags)} false "
        f"alarms in {len(right_flags)}."
    )


def all_cases(folder: Path) -> list[Case]:
    """Return the cases of joints, of servos, of limbs and of walks. folder: of the measured records."""
    from stiction_experiments.flags.cases import joint_cases
    from stiction_experiments.flags.drives import drive_cases
    from stiction_experiments.flags.limbs import limb_cases
    from stiction_experiments.flags.walks import walk_cases

    return [*joint_cases(folder), *drive_cases(folder), *limb_cases(folder), *walk_cases()]


def run(options: FlagsOptions, work: Work) -> Report:
    """Make every mistake."""
    from stiction_experiments.flags.cases import data_folder

    folder = data_folder()
    work.begin()
    todo = all_cases(folder)
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
        status=1 if any(row.confident or row.false_alarm for row in rows) else 0,
    )


STUDY = Study(
    "is any answer confident and wrong after a wrong flag", DESCRIPTION, FlagsOptions, run, results=("flags.csv",)
)
