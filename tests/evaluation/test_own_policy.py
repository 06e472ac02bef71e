"""Python function as a policy, for evaluation alone."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.deploy.observation import Sensors
from stiction.evaluation.evaluate import EvaluationCfg, evaluate_bundle
from stiction.evaluation.policies import own_policy
from stiction.robots.catalog import find_robot

CALLS: list[tuple[int, bool]] = []


def stand(sensors: Sensors, command: np.ndarray, fresh: np.ndarray) -> np.ndarray:
    """Keep the standing pose."""
    assert sensors.base_linear_velocity is not None and command.shape == (len(fresh), 3)
    CALLS.append((len(fresh), bool(fresh.any())))
    return np.tile(find_robot("go2").joint_values("default_position"), (len(fresh), 1))


def short(sensors: Sensors, command: np.ndarray, fresh: np.ndarray) -> np.ndarray:
    """Return too few targets."""
    return np.zeros((len(fresh), 3))


NOT_A_FUNCTION = 3


def test_a_function_stands_a_robot() -> None:
    """The function is called once per period with all robots; the first call marks them as reset."""
    CALLS.clear()
    bundle = own_policy(f"{__name__}:stand", "go2", 0.02)
    cfg = EvaluationCfg(friction_levels=(0.0, 0.1), commands=("stand",), episodes=1, seconds=3.5)
    done = evaluate_bundle(bundle, cfg)
    assert [row.fall_rate for row in done.rows] == [0.0, 0.0] and done.rows[0].policy == f"{__name__}.stand"
    assert CALLS == [(2, True)] + [(2, False)] * 174


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("short", r"returned targets of shape \(1, 3\)"),
        ("NOT_A_FUNCTION", "expected a function"),
        ("absent", "no 'absent'"),
    ],
)
def test_a_function_that_is_none_is_refused(name: str, message: str) -> None:
    """Rejects an invalid function in one line, before or at its first step."""
    cfg = EvaluationCfg(friction_levels=(0.0,), commands=("stand",), episodes=1, seconds=3.5)
    with pytest.raises(StictionError, match=message):
        evaluate_bundle(own_policy(f"{__name__}:{name}", "go2", 0.02), cfg)


def leaning(angle: float):
    """Return a function that commands a displaced pose."""

    def lean(sensors: Sensors, command: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        return stand(sensors, command, fresh) + angle

    return lean


def test_functions_that_differ_in_what_they_hold_are_different_policies() -> None:
    """Two closures of one name have different digests, so that neither reuses walks of the other."""
    digests = [own_policy(leaning(angle), "go2", 0.02).digest for angle in (0.0, 0.1)]
    digests += [own_policy(partial(stand), "go2", 0.02).digest, own_policy(partial(short), "go2", 0.02).digest]
    assert len({*digests}) == 4
    assert own_policy(stand, "go2", 0.02).digest == own_policy(stand, "go2", 0.02).digest
    name = f"{__name__}:stand"
    assert own_policy(name, "go2", 0.02).digest == own_policy(name, "go2", 0.02).digest
