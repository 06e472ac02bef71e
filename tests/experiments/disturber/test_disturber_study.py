"""The fresh disturber: its options, its task, a small duel that can be repeated, and what its page says."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from stiction.cli.main import main
from stiction.core.errors import ConfigurationError
from stiction.deploy.check import check_bundle
from stiction.files.bundle import Bundle, find_bundle
from stiction.files.contract import Contract
from stiction.joints.compensation import BY_SPEED, push_direction
from stiction_experiments.disturber import duel
from stiction_experiments.disturber.duel import Duel, DuelCfg, DuelRow, fight, task_for
from stiction_experiments.disturber.study import gains, report
from stiction_experiments.lab.study import write_report
from stiction_experiments.methods.disturber import LearningDisturber
from stiction_experiments.methods.hinf import HinfCfg

SMALL = DuelCfg(iterations=1, steps=4, num_envs=4, seconds=2.2)


@pytest.fixture(scope="module")
def bundle() -> Bundle:
    """A shipped policy."""
    return check_bundle(find_bundle(Path("saturn_lite-flat-deception-0.2"))).bundle


def test_a_duel_is_repeated_bit_for_bit(bundle: Bundle) -> None:
    """By its seed alone; three sides, and a push that is felt."""
    shares: list[float] = []
    rows = fight(bundle, SMALL, 3, progress=shares.append)
    assert rows == fight(bundle, SMALL, 3)
    # Four steps of learning, and three times 110 of judging, which are the most of it.
    assert shares == pytest.approx([4 / 334, 4 / 334, 114 / 334, 224 / 334])
    assert [row["disturbed_by"] for row in rows] == ["nobody", "random", "learned"]
    assert len({row["tracking_error"] for row in rows}) == 3
    assert all(row["fall_rate"] >= 0.0 and row["cost"] >= 0.0 for row in rows)


def test_the_friction_adversary_needs_friction(bundle: Bundle) -> None:
    """Without it is refused; with it, the joints have exactly what was said."""
    with pytest.raises(ConfigurationError, match="say --friction-level"):
        DuelCfg(disturber="friction")
    rows = fight(bundle, replace(SMALL, disturber="friction", friction_level=0.1), 0)
    assert len({row["tracking_error"] for row in rows}) == 3
    task = task_for(bundle.contract, replace(SMALL, friction_level=0.1))
    assert task.friction.level == 0.1 and task.friction.last.range == (1.0, 1.0)


def test_the_task_is_the_trainings_without_pushes(bundle: Bundle) -> None:
    """At one command; a policy that observes something else is refused."""
    task = task_for(bundle.contract, replace(SMALL, command="vx=-0.5"))
    assert task.commands.forward == (-0.5, -0.5) and task.commands.sideways == (0.0, 0.0)
    assert task.randomization.push_interval == 0.0 and task.randomization.armature == (0.8, 1.2)
    other: Contract = replace(bundle.contract, compensation=(0.01,) * 18, compensation_width=0.01)
    with pytest.raises(ConfigurationError, match=r"by the position error alone; train it again"):
        task_for(other, SMALL)


def test_what_a_policy_feeds_forward_it_feeds_here_too(bundle: Bundle) -> None:
    """A policy of `compensation` would else walk without what it was trained with, or not be judged at all.

    One step of all robots from the same draws: each target is moved on by the contract's angle times the direction.
    """
    angle, push = np.linspace(0.01, 0.03, 18), BY_SPEED.push
    fed = {
        "compensation": tuple(angle),
        "compensation_width": push.width,
        "compensation_speeds": (push.slow, push.fade),
    }
    plain, other = (
        Duel(replace(bundle, contract=replace(bundle.contract, **more)), SMALL, 0, "judging", 1, None)
        for more in ({}, fed)
    )
    position, velocity = plain.env.measured_position, plain.env.measured_velocity
    for arena in (plain, other):
        arena.step(None)
    moved = other.env.fleet.targets - plain.env.fleet.targets
    assert (np.abs(moved).max(0) > 0.5 * angle).all()
    # Without the encoder's error, by which both are shifted.
    asked = torch.from_numpy(plain.env.fleet.targets).float() + plain.env.randomizer.draws.encoder_offset
    direction = push_direction(velocity, asked - position, velocity, push)
    np.testing.assert_allclose(moved, (torch.from_numpy(angle).float() * direction).numpy(), atol=1e-6)


def test_the_disturber_of_a_duel_learns(bundle: Bundle, monkeypatch: pytest.MonkeyPatch) -> None:
    """Learns beyond its first guess.

    Where a forward push costs and a backward one saves, and each step is all that it has, it pushes forward at last.
    """
    arena = Duel(bundle, replace(SMALL, iterations=30, steps=12, num_envs=8), 0, "learning", 1, None)
    cfg = HinfCfg(eta=0.0, actor=(8,), critic=(8,), learning_rate=0.02, entropy=0.0)
    obs, shares = arena.env.get_observations(), []
    learner = arena.disturber(cfg, 5)
    assert isinstance(learner, LearningDisturber)
    monkeypatch.setattr(arena, "step", lambda values: (0.5 + 0.5 * values[:, 0], torch.ones(8), torch.zeros(8)))
    before = learner.mean(obs)[:, 0].mean()
    arena.learn(learner, shares.append)
    assert learner.mean(obs)[:, 0].mean() > before + 0.3
    assert shares == pytest.approx([(k + 1) / 30 for k in range(30)])


def test_joints_are_those_of_the_bundle(bundle: Bundle) -> None:
    """The robots have the bundle's inertia and viscous friction, not the data sheet's, times draws from 0.8 to 1.2."""
    contract = bundle.contract
    identified = {name: tuple((3.0 * contract.array(name)).tolist()) for name in ("armature", "damping")}
    measured = replace(contract, joints_file={"name": "joints.json", "sha256": "0" * 64}, **identified)
    for stream in ("learning", "judging"):
        fleet = Duel(replace(bundle, contract=measured), SMALL, 0, stream, 1, None).env.fleet
        for name in ("armature", "damping"):
            ratio = getattr(fleet, name) / measured.array(name)
            assert 0.79 < ratio.min() < ratio.max() < 1.21, name


def test_who_is_judged_has_one_episode(bundle: Bundle) -> None:
    """No time-out within it, however long; who is learned from is of every age, as in a training."""
    long = replace(SMALL, seconds=60.0, num_envs=64)
    judged, learned = (Duel(bundle, long, 0, stream, 1, None).env for stream in ("judging", "learning"))
    assert judged.max_episode_length == round(60.0 / judged.cfg.control_period) and not judged.episode_length_buf.any()
    assert learned.max_episode_length == round(20.0 / learned.cfg.control_period)
    assert 100 < learned.episode_length_buf.float().std() < 500  # evenly over 1000 steps: 289


def test_a_fall_changes_nothing_for_the_others(bundle: Bundle) -> None:
    """The robots of all sides are the same until one falls; then the others' noise must be the same still."""
    seen = []
    for falls in (False, True):
        env = Duel(bundle, SMALL, 0, "judging", 1, None).env
        for step in range(3):
            if falls and step == 1:
                env.fleet.qpos[0, 2] -= 0.5  # into the ground, where it has fallen
            obs, _, dones, _ = env.step(torch.zeros(4, 18))
        seen.append((obs["history"][1:], dones))
        assert bool(env.episode_length_buf[0] < 3) == falls
    assert torch.equal(seen[0][0], seen[1][0])


def test_a_fall_costs_what_it_costs_the_learner(bundle: Bundle, monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot that stands up anew would cost little, and what the disturber has learned would look like nothing.

    Ten steps of four robots count, half is lost in each, and one robot falls in each: 0.5·40 + 10·99 of 40 + 10·99.
    """
    arena = Duel(bundle, SMALL, 0, "judging", 1, None)
    one = torch.tensor([1, 0, 0, 1])
    monkeypatch.setattr(arena, "step", lambda _: (torch.full((4,), 0.5), one, torch.tensor([0, 0, 0, 1])))
    monkeypatch.setattr(arena.env, "linear_velocity", torch.zeros(4, 3), raising=False)
    figures = arena.judge(None)
    assert figures["cost"] == pytest.approx(1010 / 1030) and figures["fall_rate"] == pytest.approx(0.25 / 0.02)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"command": "stand"}, "expected a velocity forward or sideways"),
        ({"disturber": "random"}, "does not learn"),
        ({"iterations": 0}, "expected at least one of each"),
        ({"seconds": 1.0}, "from 2 to 3600 s"),
        ({"limit": 0.7}, "from 0 to 0.5"),
        ({"limit": 0.0}, "nobody disturbs"),
        ({"friction_level": -0.1}, "friction_level is -0.1; expected a fraction of the torque limit"),
    ],
)
def test_what_is_no_duel_is_refused(changes: dict, message: str) -> None:
    """In one line, before anything is simulated."""
    with pytest.raises(ConfigurationError, match=message):
        replace(SMALL, **changes)


ROWS = [
    DuelRow("some", "none", seed, who, falls, ratio, 0.1, lost)
    for seed, worse in ((0, 0.1), (1, 0.3))
    for who, falls, ratio, lost in (
        ("nobody", 0.0, 1.0, 0.2),
        ("random", 0.01, 0.9, 0.25),
        ("learned", 0.2, 0.5, 0.2 + worse),
    )
]


def test_gains_by_hand() -> None:
    """Against nobody, seed by seed: 0.1 and 0.3 are 0.2 in the mean."""
    random, learned = gains(ROWS)
    assert (random.disturbed_by, random.seeds) == ("random", 2) and random.cost == pytest.approx(0.05)
    assert learned.cost == pytest.approx(0.2) and (learned.least, learned.most) == pytest.approx((0.1, 0.3))
    assert learned.falls == pytest.approx(0.2) and learned.speed_ratio == pytest.approx(-0.5)


def test_the_page_says_what_was_lost(tmp_path: Path) -> None:
    """Both tables, the answer, and that it is a lower bound."""
    made = {"command": "stiction study disturber some", "revision": "abc", "machine": {"cpu": "p"}, "warnings": []}
    write_report(tmp_path, report(ROWS, {}), made)
    page = (tmp_path / "report.html").read_text()
    assert "some +0.200 (+0.050 by draws)" in page and "a lower bound" in page
    assert {"duels.csv", "gains.csv"} <= {file.name for file in tmp_path.iterdir()}


def test_a_rerun_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, undrawn: None) -> None:
    """Reads finished duels: after the same command nothing is fought, after one more seed that seed alone."""
    fought: list[int] = []

    def fight(bundle: Bundle, cfg: DuelCfg, seed: int, *_: object) -> list[dict]:
        fought.append(seed)
        return [asdict(replace(row, policy=bundle.name, seed=seed)) for row in ROWS[:3]]

    monkeypatch.setattr(duel, "fight", fight)
    words = ["study", "disturber", "saturn_lite-flat-deception-0.2", "--out", str(tmp_path / "out"), "--seeds"]
    assert main([*words, "0"]) == 0 and fought == [0]
    assert main([*words, "0"]) == 0 and fought == [0]
    assert main([*words, "0", "1", "--overwrite"]) == 0 and fought == [0, 1]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["settings"]["iterations"] == 100


def test_a_seed_counts_once(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Its duel is kept: named twice, it would be two samples that agree perfectly."""
    words = ["study", "disturber", "saturn_lite-flat-deception-0.2", "--out", str(tmp_path / "out"), "--seeds"]
    assert main([*words, "3", "3"]) == 1
    assert capsys.readouterr().err.count("seeds: got 3 3, expected at least one, each once") == 1
    assert not (tmp_path / "out").exists()
