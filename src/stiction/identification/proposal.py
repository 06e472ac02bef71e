"""What `stiction train --friction-from` reads: one training for all joints of a robot, by the friction of the worst."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stiction.files.joints import JointsFile, write_training
from stiction.identification.reference import CONDITIONS
from stiction.identification.verdict import TRAINABLE, TrainingNeed, friction_level, judge


def propose(file: JointsFile) -> dict[str, Any]:
    """Return what `stiction train --friction-from` reads, as plain data.

    One training for all joints, by the friction of the worst: what `train` draws is a share of each joint's own limit.
    `joints` has each joint's ratio, at rest where that is more, and the level that would cover it, `advice` what the
    choice rests on. `friction` is null, and `text` says why, where no joint has a ratio, or where one is beyond what
    can be trained. A joint whose fit is not valid has no level.
    """
    levels = {name: level for name, one in file.joints.items() if (level := friction_level(one)) is not None}
    beyond = [name for name, level in levels.items() if level >= TRAINABLE]
    objections = [f"{name} is not valid: {each.text}" for name, one in file.joints.items() for each in one.objections]
    need = TrainingNeed(None, ())
    if not levels and objections:
        text = f"the fit of {objections[0]}"
    elif not levels:
        text = "no rotary joint has a ratio of friction to torque limit: identify with --torque-limit"
    elif beyond:
        text = f"{', '.join(beyond)} would need level {TRAINABLE:g} or more, which leaves nothing to walk with: mend it"
    else:
        worst = max(levels, key=lambda name: levels[name])
        verdict = file.joints[worst].diagnostics.get("verdict")
        robot = verdict.get("robot") if isinstance(verdict, dict) else None
        need = judge(file.joints[worst], robot=robot if isinstance(robot, str) else None)
        text = f"{_reason(file, levels, worst)}. The training {need.proposal}"
        text += f" {need.advice.comparison}" if need.advice else ""
    return {
        "friction": need.training,
        "range": need.advice and need.advice.range,
        "text": text,
        "advice": need.advice and need.advice.to_dict(),
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


def _reason(file: JointsFile, levels: dict[str, float], worst: str) -> str:
    """Say which joint sets the level, and which joints were not asked."""
    record = file.joints[worst]
    measured = CONDITIONS.get(record.test_condition or "", "under no stated condition")
    text = f"provisional; level {levels[worst]:g} of {worst}, the worst of {len(levels)}, measured {measured}"
    text += ", by what holds it at rest" if record.holding_friction is not None else ""
    if record.test_condition != "loaded":
        text += ", with a margin chosen, not measured, for the load that was not on it"
    left = [name for name in file.joints if name not in levels]
    return text + (f"; not valid or without a ratio, and so not asked: {', '.join(left)}" if left else "")


def write_proposal(folder: Path, file: JointsFile) -> None:
    """Write `training.json` beside a `joints.json`; none, and none of before, where no joint's fit is valid.

    May raise `OSError`.
    """
    path, known = folder / "training.json", [record for record in file.joints.values() if record.diagnostics]
    if known and all(record.objections for record in known):
        path.unlink(missing_ok=True)
    else:
        write_training(path, propose(file))
