"""A virtual robot in PhysX or ODE needs no MuJoCo: its package may be missing."""

from __future__ import annotations

import subprocess
import sys

import pytest

from stiction.engines.catalog import missing_engine
from stiction.robots.catalog import find_robot

WALK = """
import sys
sys.modules["mujoco"] = None  # importing it fails from now on
from functools import partial
import numpy as np
from stiction.engines.catalog import make_engine
from stiction.files.bundle import read_bundle, shipped_bundles
from stiction.virtual.cases import Case, parse_level
from stiction.virtual.trial import World, walk
import stiction.virtual.bench
bundle = read_bundle(shipped_bundles()["saturn_lite-flat-none-0.2"])
world = World(partial(make_engine, sys.argv[1]))
done = walk(bundle, Case(1, "all", parse_level("bench+0.02")), world, lambda step, motion: np.array([0.5, 0, 0]), 3)
print(len(done.steps))
"""


@pytest.mark.parametrize("engine", ["physx", "ode"])
def test_a_virtual_robot_walks_where_mujoco_cannot_be_imported(engine: str) -> None:
    """Whoever has one of the other engines would have to install a simulator that is not used."""
    if missing := missing_engine(engine, find_robot("saturn_lite")):
        pytest.skip(missing)
    done = subprocess.run([sys.executable, "-c", WALK, engine], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "3\n"), done.stderr
