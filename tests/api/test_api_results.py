"""Return values of the public functions: three lines, a table without scripts, the verb's JSON and files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import stiction
from stiction.api.identification import Identified
from stiction.cli import identify as verb
from stiction.files.log import Log, write_log
from stiction.identification.example import Excitation, example_log


@pytest.fixture(scope="module")
def log() -> Log:
    """Return a short log of a joint whose friction is 0.442 N m, called as an attacker would call it."""
    short = example_log(excitation=Excitation(duration=8.0), seed=3)
    return stiction.from_arrays(
        time=short.time,
        **{role: {"<script>": getattr(short.joints["shank"], role)} for role in ("position", "target", "torque")},
        **{"kp": 20.0, "kd": 0.5, "torque_limit": 45.0, "test_condition": "bare_motor"},
    )


@pytest.fixture(scope="module")
def result(log: Log) -> Identified:
    """Return what is identified of it."""
    return stiction.identify(log)


def test_an_identification_says_its_verdict_at_a_glance(result: Identified) -> None:
    """A printed result is the answer as the terminal has it, in short lines; `verdict` has the reasons."""
    facts, answer, step, why = repr(result).splitlines()
    assert facts.startswith("Friction 0.44") and ".verdict" in why
    assert answer == "Matters: CANNOT BE TOLD without the task"
    assert step.startswith("Next: stiction convert joints.json ") and max(map(len, (facts, answer, step))) < 80
    assert len(result.verdict) == 3
    low, high = result["<script>"].coulomb_friction.interval95
    assert low < 0.442 < high and result.valid


def test_a_fit_that_is_not_valid_hands_out_no_number(log: Log) -> None:
    """Torque in another unit: the record by its name has no friction and no interval, and says why."""
    wrong = stiction.identify(log, torque_scale=2.0)
    (name,) = wrong
    record = wrong[name]
    assert not wrong.valid and record.objections and record.combinations == {}
    assert record.coulomb_friction is record.inertia is record.friction_ratio is record.dead_band is None
    assert wrong.joints[name].coulomb_friction is not None and "not known" in str(wrong.table())


def test_it_is_what_the_verb_prints_and_writes(
    log: Log, result: Identified, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The API and the command line must not disagree; and a saved identification is read back as it was."""
    write_log(tmp_path / "swing.npz", log)
    assert verb.main([str(tmp_path / "swing.npz"), "--out", str(tmp_path / "verb"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    mine = json.loads(json.dumps(result.to_dict()))
    strip = json.dumps(mine["joints"]).replace("the arrays", "swing.npz")
    assert json.loads(strip)["<script>"]["coulomb_friction"] == printed["joints"]["<script>"]["coulomb_friction"]
    folder = result.save(tmp_path / "api")
    assert {path.name for path in folder.iterdir()} == {path.name for path in (tmp_path / "verb").iterdir()} - {
        "settings.json"
    }
    again = stiction.load_joints(folder)
    assert again.to_dict() == result.to_dict()
    assert again.signals["<script>"].fitted_torque == pytest.approx(result.signals["<script>"].fitted_torque)


def test_a_policy_is_checked_before_it_is_loaded(tmp_path: Path) -> None:
    """A bundle with one altered byte must not come back as a policy."""
    from stiction.files.bundle import find_bundle

    folder = tmp_path / "altered"
    folder.mkdir()
    for file in find_bundle(Path("saturn_lite-flat-none-0.2")).iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    network = bytearray((folder / "policy.onnx").read_bytes())
    network[len(network) // 2] ^= 1
    (folder / "policy.onnx").write_bytes(network)
    with pytest.raises(stiction.StictionError, match=r"policy\.onnx"):
        stiction.load_policy(folder)


def test_a_loaded_policy_computes_what_its_recording_says() -> None:
    """The network that is run is the one that was checked."""
    policy = stiction.load_policy("saturn_lite-flat-none-0.2")
    golden = policy.bundle.golden
    actions = np.clip(policy.network(golden.observation[:5]), -policy.contract.action_clip, policy.contract.action_clip)
    assert actions == pytest.approx(golden.action[:5], abs=1e-5)
