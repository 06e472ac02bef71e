"""Logs that leave a parameter open, at every place where its equations are solved."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from equation import equation_rows
from held import held_log
from stiction.core.errors import StictionError
from stiction.identification.consistency import friction_at
from stiction.identification.example import SATURN_LITE, example_log
from stiction.identification.intervals import jackknife_covariance, make_blocks, robust_covariance
from stiction.identification.limb.fit import fit_blocks
from stiction.identification.limb.regression import LimbRows, fit_limb
from stiction.identification.model import Model
from stiction.identification.pipeline import identify_joint
from stiction.identification.record import hanging_bias
from stiction.identification.regression import fit_at, fit_rows
from stiction.identification.runs import hanging, make_run
from stiction.identification.setup import IdentifySetup

PLAIN = {"inertia": 0.02, "viscous_friction": 0.07, "coulomb_friction": 0.4, "offset": -0.05}
ALIKE = np.column_stack([np.linspace(1, 2, 40)] * 2)
"""Two columns that are one."""


def test_a_joint_that_slips_at_once_is_identified() -> None:
    """0.5 N m at rest, 0.3 in motion: the regression has no row of a joint at rest."""
    record = identify_joint(held_log(0.5, 0.3, 1)).record
    assert record.objections == () and record.friction_law["law"] == "breakaway"
    assert record.coulomb_friction.value == pytest.approx(0.3, rel=0.01)
    assert record.static_friction.value == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("speed", [1e-3, 1e-5])
@pytest.mark.filterwarnings("error")
def test_a_fall_of_friction_below_all_rows_leaves_the_rest_known(speed: float) -> None:
    """Friction at rest has no rows, or one: it is open, and inertia and friction in motion have their deviations."""
    rows = equation_rows(PLAIN, noise=0.01 * np.cos(np.arange(2000.0)))
    rows = rows.take(np.abs(rows.velocity) > 0.02)
    plain, law = fit_rows(rows, Model()), {"static_friction": 0.7, "stribeck_velocity": speed}
    fit = fit_at(rows, Model("stribeck"), plain.by_name | law)
    estimates = fit.estimates()
    assert np.isinf(estimates["static_friction"].std)
    for name in PLAIN:
        assert estimates[name].std == pytest.approx(plain.estimates()[name].std, rel=1e-2), name
    assert np.isfinite(friction_at(fit, 1.0).std)


def test_covariances_of_two_alike_columns() -> None:
    """The sandwich is infinite for both, and the jackknife, whose callers refuse, raises; a prior tells them apart."""
    blocks = make_blocks(ALIKE, np.cos(np.arange(40.0)), np.repeat(np.arange(10), 4))
    np.testing.assert_array_equal(robust_covariance(blocks), np.diag([np.inf, np.inf]))
    with pytest.raises(np.linalg.LinAlgError):
        jackknife_covariance(blocks, np.zeros(2))
    assert np.isfinite(jackknife_covariance(blocks, np.array([0.0, 1.0]))).all()


def test_a_phase_that_gravity_does_not_tell_is_not_stated() -> None:
    """A joint that stands almost still: its gravity is an offset, and neither bias nor hanging angle is known."""
    rows = equation_rows(PLAIN | {"gravity_sin": 2.2})
    still = replace(rows, position=np.full(len(rows), 0.2))
    fit = fit_rows(still, Model(gravity=True))
    assert np.isinf(fit.covariance.diagonal()[list(fit.names).index("gravity_sin")])
    assert hanging_bias(fit, 0.0) is None
    run = make_run(example_log(SATURN_LITE), None, IdentifySetup())
    with pytest.raises(StictionError, match="hangs straight down"):
        hanging("log", replace(run.prepared, position=np.full_like(run.prepared.position, 0.2)))


def test_swings_and_limbs_whose_columns_are_alike_are_refused() -> None:
    """Rejects columns that are equal but for rounding, for which LAPACK alone returns values of 1e9."""
    nearly = ALIKE + 3e-8 * np.cos(np.arange(80.0).reshape(40, 2))
    with pytest.raises(np.linalg.LinAlgError):
        fit_blocks(("one", "other"), nearly, np.ones(40), np.repeat(np.arange(4), 10))
    time = SimpleNamespace(torque=np.ones(40), time=np.arange(40.0))
    joint = SimpleNamespace(run=SimpleNamespace(prepared=time, rows=time), torque=np.ones(40), regressor=nearly)
    with pytest.raises(np.linalg.LinAlgError):
        fit_limb(LimbRows(("one", "other"), np.array([np.inf, np.inf]), (joint,)))
