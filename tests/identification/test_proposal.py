"""Proposal for a whole robot."""

from __future__ import annotations

import re
from dataclasses import replace

from stiction.files.advice import TRAINING
from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.files.method import find_method
from stiction.identification.advice import shipped
from stiction.identification.verdict import propose
from stiction.task.friction import FrictionCfg


def record(high: float, condition: str | None = "loaded", **changes) -> JointRecord:
    """Return a joint whose ratio is at most `high`."""
    ratio = Estimate(0.9 * high, 0.05 * high, (0.8 * high, high))
    return JointRecord(**({"friction_ratio": ratio, "test_condition": condition} | changes))


def test_what_is_proposed_is_what_training_takes() -> None:
    """Method, range and fields are written twice, for identification does not import training."""
    ways = shipped()[TRAINING].methods.values()
    assert len(ways) >= 2 and all(find_method(way.method).friction_range == (way.low, way.high) for way in ways)
    for high in (0.01, 0.2, 0.3):
        told = propose(JointsFile({"shank": record(high)}))
        cfg = FrictionCfg(**told["friction"])
        assert told["range"] == [end * cfg.level for end in cfg.last.range]


def test_the_worst_joint_sets_the_level() -> None:
    """3 % under load is level 0.03; 2 % in the air, doubled, is 0.04: that one."""
    told = propose(JointsFile({"FL_thigh": record(0.03), "FL_shank": record(0.02, "in_air"), "FL_hip": JointRecord()}))
    assert told["friction"] == {"method": "deception", "level": 0.2, "law": "coulomb", "per": "robot"}
    assert told["range"] == [0.0, 0.24] and told["advice"]["levels"] == [0.0, 0.1]
    levels = {name: joint["friction_level"] for name, joint in told["joints"].items()}
    assert levels == {"FL_thigh": 0.03, "FL_shank": 0.04, "FL_hip": None}
    assert "FL_shank, the worst of 2" in told["text"] and "not asked: FL_hip." in told["text"]
    assert "margin" in told["text"] and "provisional" in told["text"]


def test_no_level_is_proposed_where_none_is_known_or_trainable() -> None:
    """Null, with the reason; a good joint does not hide a seized one, and a drive's rail is no leg."""
    for records, message in (
        ({"shank": JointRecord()}, "--torque-limit"),
        ({"shank": record(0.9), "hip": record(0.01)}, "shank would need"),
        ({"rail": record(0.1, axis="linear")}, "no rotary joint"),
    ):
        told = propose(JointsFile(records))
        assert told["friction"] is None and told["range"] is None and message in told["text"]


def test_the_proposal_says_what_it_does_not_cover() -> None:
    """Whoever reads training.json alone learns whose evidence it is, and that load is not in it."""
    loaded = record(0.15, load_coefficient=Estimate(0.1, 0.01, (0.08, 0.12)))
    told = propose(JointsFile({"shank": replace(loaded, diagnostics={"verdict": {"robot": "go2"}})}))
    assert re.search(
        "It (nearly )?covers 15 %|It does not cover 15 %|Whether it covers 15 % is not known", told["text"]
    )
    assert "of Go2 nothing is known directly" in told["text"]
    assert "What load adds to this joint's friction, 0.1 (95 %: 0.08 to 0.12) times" in told["text"]
    assert told["advice"]["robot"] == "saturn_lite" and told["advice"]["tables"] == list(shipped()[TRAINING].tables)
    for odd in ({}, {"verdict": None}, {"verdict": {"robot": 3}}):
        told = propose(JointsFile({"shank": record(0.15, diagnostics=odd)}))
        assert "of any other robot nothing is known directly" in told["text"] and "load adds" not in told["text"]
