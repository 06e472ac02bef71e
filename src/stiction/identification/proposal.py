"""What `stiction train --friction-from` reads: one training for all joints of a robot, by the friction of the worst."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stiction.files.joints import JointRecord, JointsFile, write_training
from stiction.identification.reference import CONDITIONS
from stiction.identification.verdict import TRAINABLE, TrainingNeed, friction_level, judge


def propose(file: JointsFile) -> dict[str, Any]:
    """Return what `stiction train --friction-from` reads, as plain data.

    One training for all joints, by the friction of the worst: what `train` draws is a share of each joint's own limit.
    `joints` has each joint's ratio, at rest where that is more, and the level that would cover it, `advice` what the
    choice rests on. `friction` is null, and `text` says why, where no joint has a ratio, or where one is beyond what
    can be trained. A joint whose fit is not valid has no level.
    """
    levels = {
        name: friction_level(record.friction_ratio, record.test_condition)
        for name, record in file.joints.items()
        if record.friction_ratio is not None and record.axis == "rotary" and not _invalid_fit(record)
    }
    beyond = [name for name, level in levels.items() if level >= TRAINABLE]
    invalid = [name for name, record in file.joints.items() if record.objections]
    proposed = TrainingNeed(None, ())
    if not levels and invalid:
        text = f"the fit of {invalid[0]} is not valid: {file.joints[invalid[0]].objections[0].text}"
    elif not levels:
        text = "no rotary joint has a ratio of friction to torque limit: identify with --torque-limit"
    elif beyond:
        text = f"{', '.join(beyond)} would need level {TRAINABLE:g} or more, which leaves nothing to walk with: mend it"
    else:
        worst = max(levels, key=lambda name: levels[name])
        proposed = judge(file.joints[worst], robot=_robot(file.joints[worst]))
        text = _reason(file, levels, worst) + (f". {proposed.advice.text}" if proposed.advice else "")
        text += f" {proposed.uncovered}" if proposed.uncovered else ""
    return {
        "friction": proposed.training,
        "range": proposed.range,
        "text": text,
        "advice": proposed.advice and proposed.advice.to_dict(),
        "joints": {
            name: {
                "friction_ratio": record.friction_ratio and record.friction_ratio.to_dict(),
                "dynamic_ratio": record.dynamic_ratio and record.dynamic_ratio.to_dict(),
                "dead_band": record.dead_band and record.dead_band.to_dict(),
                "test_condition": record.test_condition,
                "friction_level": levels.get(name),
            }
            for name, record in file.joints.items()
        },
    }


def _robot(record: JointRecord) -> str | None:
    """Return whose joint it is, as the verdict in the file says; None where it does not."""
    verdict = record.diagnostics.get("verdict")
    name = verdict.get("robot") if isinstance(verdict, dict) else None
    return name if isinstance(name, str) else None


def _invalid_fit(record: JointRecord) -> bool:
    """Return whether no level may be taken from a record; one of an older file may not say so itself."""
    ratio = record.friction_ratio
    return bool(record.objections) or (ratio is not None and ratio.interval95[0] <= 0)


def _reason(file: JointsFile, levels: dict[str, float], worst: str) -> str:
    """Say which joint sets the level, and which joints were not asked."""
    condition = file.joints[worst].test_condition
    stated = CONDITIONS.get(condition or "", "under no stated condition")
    text = f"provisional; level of {worst}, the worst of {len(levels)}, measured {stated}"
    record = file.joints[worst]
    if record.friction_ratio is not None and record.dynamic_ratio is not None:
        rest, motion = record.friction_ratio.value, record.dynamic_ratio.value
        text += f", by what holds it at rest, {100 * rest:.3g} % of the torque limit ({100 * motion:.3g} % in motion)"
    if condition != "loaded":
        text += ", with a margin chosen, not measured, for the load that was not on it"
    invalid = [name for name, record in file.joints.items() if _invalid_fit(record)]
    left = [name for name in file.joints if name not in levels and name not in invalid]
    text += f"; not valid, and so not asked: {', '.join(invalid)}" if invalid else ""
    return text + (f"; without a ratio, and so not asked: {', '.join(left)}" if left else "")


def write_proposal(folder: Path, file: JointsFile) -> None:
    """Write `training.json` beside a `joints.json`; none, and none of before, where no joint's fit is valid.

    May raise `OSError`.
    """
    path, known = folder / "training.json", [record for record in file.joints.values() if record.diagnostics]
    if known and all(record.objections for record in known):
        path.unlink(missing_ok=True)
    else:
        write_training(path, propose(file))
