"""Four public walking policies on robots that are not part of this project.

Unpacked side by side into the folder that STICTION_ROBOTS names: holosoma-inference 0.1.3 (the networks) and holosoma
0.0.3 (G1 and T1), see `tests/robots/test_strangers.py`; `results/others` evaluates them under friction.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from stiction.evaluation.evaluate import EvaluationCfg, evaluate_bundle
from stiction.exchange.policies.importer import import_policy

WHEELS = Path(os.environ.get("STICTION_ROBOTS", "/nowhere"))
MODELS = WHEELS / "holosoma_inference" / "models"
SAID = Path(__file__).with_name("theirs")

pytestmark = pytest.mark.skipif(
    not MODELS.is_dir(),
    reason="policies of others are not here: unpack the wheels holosoma and holosoma-inference, name the folder in "
    "STICTION_ROBOTS",
)


@pytest.mark.parametrize(("robot", "policy"), [("g1", "fastsac"), ("t1", "ppo")])
def test_a_policy_of_others_walks(robot: str, policy: str, tmp_path: Path) -> None:
    """At half a metre a second and without friction: every order, scale, gain and phase is then right."""
    for name in ("holosoma", "holosoma_inference"):
        (tmp_path / name).symlink_to(WHEELS / name)
    for file in SAID.glob("*.yaml"):
        shutil.copy(file, tmp_path)
    path = MODELS / "loco" / f"{robot}_29dof" / f"{policy}_{robot}_29dof.onnx"
    settings = [tmp_path / f"{robot}-policy.yaml"]
    bundle = import_policy(path, str(tmp_path / f"{robot}.yaml"), tmp_path / "bundle", settings).bundle
    cfg = EvaluationCfg(friction_levels=(0.0,), commands=("vx=0.5",), episodes=1, seconds=5.0)
    (metrics,) = evaluate_bundle(bundle, cfg).metrics
    assert metrics.columns["fall_rate"] == 0.0 and metrics.columns["speed_ratio"] > 0.6
