"""What to train a robot with, from every joint that was identified: the contents of `training.json`."""

from __future__ import annotations

from typing import Any

from stiction.formats.joints import JointRecord, JointsFile
from stiction.identify.advice import Advice, advise
from stiction.identify.evidence import TRAINABLE, friction_level
from stiction.identify.reference import CONDITIONS
from stiction.identify.verdict import WITHOUT, Verdict, verdict


def judge(record: JointRecord) -> Verdict:
    """Return the verdict on a record, from its ratio and dead band; newton metres may be null."""
    return verdict(record.coulomb_friction, record.friction_ratio, record.dead_band, record.test_condition, record.axis)


def propose(file: JointsFile) -> dict[str, Any]:
    """Return what `stiction train --friction-from` reads, as plain data.

    One training for all joints, by the friction of the worst: what `train` draws is a share of each joint's own limit.
    `joints` has each joint's ratio and the level that would cover it, `advice` what the choice rests on. `friction` is
    null, and `text` says why, where no joint has a ratio, or where one is beyond what can be trained.
    """
    levels = {
        name: friction_level(record.friction_ratio, record.test_condition)
        for name, record in file.joints.items()
        if record.friction_ratio is not None and record.axis == "rotary"
    }
    beyond = [name for name, level in levels.items() if level >= TRAINABLE]
    worst = max(levels, key=lambda name: levels[name], default=None)
    settings, advice = None, None
    if worst is None:
        text = "no rotary joint has a ratio of friction to torque limit: identify with --torque-limit"
    elif beyond:
        text = f"{', '.join(beyond)} would need level {TRAINABLE:g} or more, which leaves nothing to walk with: mend it"
    else:
        advice = _advice(file, levels, worst)
        settings = WITHOUT if advice is None else advice.settings
        text = _reason(file, levels, worst) + ("" if advice is None else f". {advice.text}")
    return {
        "friction": settings,
        "range": None if settings is None else [0.0, 0.0] if advice is None else advice.range,
        "text": text,
        "advice": advice and advice.to_dict(),
        "joints": {
            name: {
                "friction_ratio": record.friction_ratio and record.friction_ratio.to_dict(),
                "dead_band": record.dead_band and record.dead_band.to_dict(),
                "test_condition": record.test_condition,
                "friction_level": levels.get(name),
            }
            for name, record in file.joints.items()
        },
    }


def _advice(file: JointsFile, levels: dict[str, float], worst: str) -> Advice | None:
    """Return what to train with, from what was measured of the worst joint to its level; None without friction."""
    ratio = file.joints[worst].friction_ratio
    return None if ratio is None or not levels[worst] else advise(max(ratio.interval95[0], 0.0), levels[worst])


def _reason(file: JointsFile, levels: dict[str, float], worst: str) -> str:
    """Say which joint sets the level, and which joints were not asked."""
    condition = file.joints[worst].test_condition
    stated = CONDITIONS.get(condition or "", "under no stated condition")
    text = f"provisional; level of {worst}, the worst of {len(levels)}, measured {stated}"
    if condition != "loaded":
        text += ", with a margin chosen, not measured, for the load that was not on it"
    left = [name for name in file.joints if name not in levels]
    return text + (f"; without a ratio, and so not asked: {', '.join(left)}" if left else "")
