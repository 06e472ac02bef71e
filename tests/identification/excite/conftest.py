"""One small design that the tests of this folder share."""

from __future__ import annotations

import pytest

from stiction.identification.excite import design
from stiction.identification.excite.plan import Excitation, design_excitation
from stiction.identification.excite.setup import ExciteSetup
from stiction.identification.excite.task import Task
from stiction.joints.pd import PDGains

SETUP = ExciteSetup(torque_limit=45.0, coulomb=0.44, duration=8.0, rate=250.0, speed_limit=8.0).filled()
"""The paper's Saturn Lite shank, and a log of one short pattern."""


@pytest.fixture(scope="session")
def made() -> Excitation:
    """Return the design, after a short search."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(design, "GENERATIONS", 1)
        return design_excitation(SETUP, "shank", "stiction excite")


@pytest.fixture(scope="session")
def task(made: Excitation) -> Task:
    """Return the task of the design at the gains that were chosen."""
    gains = made.record.gains
    return Task(SETUP).with_gains(PDGains(gains["kp"], gains["kd"]))
