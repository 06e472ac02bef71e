"""A design as a whole: its predictions, compared with simulated logs."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from counts import count
from excitations import search_little
from stiction.core.errors import StictionError
from stiction.files.log import JointSignals, Log
from stiction.identification.excite import design
from stiction.identification.excite.design import choose_gains
from stiction.identification.excite.pattern import Pattern
from stiction.identification.excite.plan import Excitation, design_excitation, duration_for
from stiction.identification.excite.setup import ExciteSetup
from stiction.identification.excite.task import SHARE, Task
from stiction.identification.pipeline import identify_joint
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, simulate

LOGS = count(20, 40)
"""Simulated logs: the deviation of a deviation is 16 % of 20, and 11 % of 40."""


def pattern_of(made: Excitation) -> Pattern:
    """Return the design's motion from its record."""
    return Pattern(**{name: tuple(v) if isinstance(v, list) else v for name, v in made.record.pattern.items()})


def test_predicted_deviations_are_those_of_estimates_from_simulated_logs(made: Excitation, task: Task) -> None:
    """Predicted deviations equal those of nonlinear least squares on the whole log, noise known."""
    target = made.trajectory.joints["shank"].target
    assert target is not None
    truth = np.array([0.0145, 0.07, 0.44, 0.0])
    scale = np.array([row.std for row in made.record.predicted])

    def signals(values: np.ndarray) -> np.ndarray:
        inertia, viscous, coulomb, offset = (float(value) for value in values)
        run = simulate(Joint(inertia, viscous, Coulomb(coulomb), offset), task.gains, 1 / task.setup.rate, target)
        return np.concatenate([run.position / 1e-4, run.torque / 0.05])

    clean, rng = signals(truth), np.random.default_rng(1)
    estimates = []
    for _ in range(LOGS):
        logged = clean + rng.standard_normal(len(clean))
        begin = truth + 30 * scale * rng.standard_normal(4)
        fit = least_squares(
            lambda x, begin=begin, logged=logged: signals(begin + x * scale) - logged, np.zeros(4), diff_step=0.1
        )
        estimates.append(begin + fit.x * scale)
    assert np.std(estimates, axis=0) / scale == pytest.approx(np.ones(4), abs=0.3)
    assert np.abs(np.mean(estimates, axis=0) - truth) == pytest.approx(np.zeros(4), abs=0.5 * scale.max())


def test_limits_hold_for_every_joint_that_was_thought_possible(made: Excitation, task: Task) -> None:
    """Corners of the box and joints drawn inside it, in the whole trajectory as it is written."""
    target = made.trajectory.joints["shank"].target
    assert target is not None
    rng = np.random.default_rng(0)
    inside = [task.values * np.array([*2 ** rng.uniform(-1, 1, 3), 1.0]) for _ in range(10)]
    for values in [*task.candidates(), *inside]:
        run = task.run(values, target)
        assert min(run.position.min(), target.min()) > -0.6 and max(run.position.max(), target.max()) < 0.6
        assert np.abs(run.velocity).max() < 8.0 and np.abs(run.torque).max() < 45.0
    reached = made.record.reached
    assert reached["speed"] == pytest.approx(made.signals.velocity_high.max(), rel=0.5)
    assert reached["speed"] <= SHARE * 8.0 * 1.05


def test_a_tight_limit_is_the_one_that_is_kept() -> None:
    """Each limit in turn made tight: the motion shrinks until that limit, and no other, is nearly used up."""
    base = ExciteSetup(torque_limit=45.0, coulomb=0.44, duration=8.0, rate=250.0)
    for name, wrong in (("speed", {"speed_limit": 2.0}), ("torque", {"torque_limit": 2.5, "spread": 1.2})):
        task = Task(replace(base, **wrong).filled())
        pattern = task.within_limits(design.pattern_of(task, design.starters()[1]), task.candidates())
        assert pattern is not None
        runs = [
            task.limit_use(task.target(pattern), task.run(values, task.target(pattern))) for values in task.candidates()
        ]
        worst = {key: max(use[key] for use in runs) for key in runs[0]}
        assert 0.8 * SHARE < worst[name] <= SHARE * 1.0001 and max(worst, key=lambda key: worst[key]) in (
            name,
            "position",
        )


def test_the_trajectory_starts_and_ends_at_rest_at_the_start_pose(made: Excitation) -> None:
    """The trajectory starts and ends at rest at the start pose."""
    target = made.trajectory.joints["shank"].target
    assert target is not None and target[0] == target[-1] == 0.0
    assert np.abs(np.diff(target)).max() * 250.0 < 40.0 and abs(target[1]) < 1e-3
    assert len(target) == 2001 and made.trajectory.time[-1] == pytest.approx(8.0)


def test_gains_are_lowered_only_where_the_joint_still_tracks(made: Excitation) -> None:
    """Friction of 0.44 N m at kp 20: half of it and less is better, and the lowest of all no longer moves enough."""
    by_kp = {trial.kp: trial for trial in made.record.trials}
    chosen = by_kp[made.record.gains["kp"]]
    assert made.record.gains["kp"] < 20.0 and chosen.tracks and not made.record.trials[-1].tracks
    assert (chosen.worst or np.inf) < 0.9 * (by_kp[20.0].worst or 0.0)
    assert "not at the given kp 20" in made.record.advice
    fixed = ExciteSetup(duration=8.0, rate=250.0, coulomb=0.44, fixed_gains=True).filled()
    gains, _ = choose_gains(Task(fixed), lambda share: None)
    assert gains == PDGains(20.0, 0.5)


@pytest.mark.parametrize(
    ("kp", "spread", "message"),
    [
        (2.0, 2.0, r"friction of 2 N m.*dead band at kp 2 is 1 rad.*raise --kp above 3.7, or"),
        (5.0, 2.0, r"--spread 2 allows for friction of 4 N m.*kp 5 is 0.8 rad.*above 7.41, lower --spread, or"),
    ],
)
def test_friction_that_holds_the_joint_is_refused_with_the_gain_that_would_do(
    kp: float, spread: float, message: str
) -> None:
    """Friction of 2 N m, perhaps 4, against kp × 0.54 rad."""
    setup = ExciteSetup(kp=kp, coulomb=2.0, torque_limit=45.0, spread=spread)
    with pytest.raises(StictionError, match=message):
        design_excitation(setup.filled(), "shank", "")


def test_a_speed_limit_that_no_motion_keeps_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A joint that breaks away at all is faster than that."""
    monkeypatch.setattr(design, "GENERATIONS", 1)
    setup = ExciteSetup(speed_limit=1e-4, duration=8.0, rate=250.0).filled()
    with pytest.raises(StictionError, match=r"no motion within .* 0.0001 rad/s"):
        design_excitation(setup, "shank", "")


def test_the_time_for_a_wanted_deviation_follows_from_its_square(made: Excitation, task: Task) -> None:
    """A third of the deviation takes nine patterns; and one is the least."""
    beliefs = [task.information(values, pattern_of(made)) for values in task.candidates()]
    friction = max(float(belief.relative[2]) for belief in beliefs)
    assert duration_for(task, beliefs, friction / 2.999) == 9 * 8.0
    assert duration_for(task, beliefs, 0.5) == made.record.wanted["duration"] == 8.0
    assert made.record.wanted["relative"] == 0.02


def test_a_robot_that_plays_it_back_is_identified(made: Excitation, task: Task) -> None:
    """Round trip: the joint is not the one guessed, and identification finds it from the log of the trajectory."""
    target = made.trajectory.joints["shank"].target
    assert target is not None
    truth, rng = Joint(0.012, 0.09, Coulomb(0.3), 0.02), np.random.default_rng(2)
    run = simulate(truth, task.gains, 1 / task.setup.rate, target)
    logged = JointSignals(
        position=run.position + 1e-4 * rng.standard_normal(len(target)),
        target=target,
        torque=run.torque + 0.05 * rng.standard_normal(len(target)),
    )
    setup = replace(made.trajectory.setup, torque_source="motor_side", test_condition="bare_motor")
    record = identify_joint(Log("log.csv", made.trajectory.time, {"shank": logged}, setup)).record
    assert record.inertia is not None and record.viscous_friction is not None and record.coulomb_friction is not None
    assert record.inertia.value == pytest.approx(0.012, rel=0.02)
    assert record.viscous_friction.value == pytest.approx(0.09, rel=0.05)
    assert record.coulomb_friction.value == pytest.approx(0.3, rel=0.02)


def test_gravity_is_planned_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """A link that weighs 1 N m: limits hold with its weight, which is predicted too, and JSON takes the record."""
    search_little(monkeypatch)
    setup = ExciteSetup(gravity_sin=1.0, torque_limit=20.0, duration=6.0, rate=200.0, position_only=True).filled()
    record = design_excitation(setup, "shank", "").record
    assert [row.name for row in record.predicted][-2:] == ["gravity_sin/k", "gravity_cos/k"]
    assert -0.6 < record.reached["low"] < record.reached["high"] < 0.6
    assert any("only combinations" in text for text in record.warnings)
    json.dumps(record.to_dict(), allow_nan=False)
