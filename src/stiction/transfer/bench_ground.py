"""Boxes against height fields: the same stairs both ways, the same robots, the same targets, side by side in one run.

The task walks on boxes (`sim/terrain.py`); this is the measurement that the choice rests on. Height fields are of two
kinds: with square cells, as any ground would need, and with cells as wide as the stairs, which only steps across one
axis allow. Their risers lean by one cell.
"""

from __future__ import annotations

import time
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch

from stiction.robots.build import build
from stiction.robots.spec import RobotSpec
from stiction.sim.terrain import REACH, STEPS, half_sizes, stair_height

STEP = 0.10
"""Height of a step [m]."""

CELL = 0.02
"""Cell of the height fields along the way [m]: a riser leans by this much over its height."""

GROUNDS = ("plane", "boxes", "height field, wide cells", "height field, square cells")
"""What is measured; the first is what the others are compared with."""


def ground_model(spec: RobotSpec, ground: str, timestep: float = 0.005) -> mujoco.MjModel:
    """Return a robot on one of `GROUNDS`; the steps go along x, and are as wide as the square stairs."""
    model = build(spec, timestep)
    if ground == "boxes":
        for number, (half, _, thick) in enumerate(half_sizes("stairs")):
            top = STEP * (number + 1)
            kind = mujoco.mjtGeom.mjGEOM_BOX
            model.worldbody.add_geom(type=kind, size=[half, REACH, thick], pos=[0.0, 0.0, top - thick])
    elif ground != "plane":
        # MuJoCo stretches heights from the lowest to the highest: there must be ground at zero.
        half = REACH + CELL
        columns = round(2 * half / CELL) + 1
        rows = columns if "square" in ground else 2
        way = np.linspace(-half, half, columns)
        profile = stair_height(np.stack((way, np.zeros(columns)), -1)[None], np.array([[STEP]]))[0]
        top = STEP * STEPS
        model.add_hfield(
            name="stairs",
            size=[half, half, top, 0.1],
            nrow=rows,
            ncol=columns,
            userdata=np.tile(profile / top, rows).tolist(),
        )
        model.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="stairs")
    return model.compile()


def measure_grounds(spec: RobotSpec, num: int, blocks: int, threads: int) -> dict[str, Any]:
    """Return control steps a second on every ground, by block and as medians, and their ratios to the plane's.

    The robots stand all over the stairs and follow random targets, the same on every ground; each block goes through
    all grounds in turn, so that a busy machine slows all of them.
    """
    rng = np.random.default_rng(0)
    place = rng.uniform(-REACH, REACH, (num, 2)) * (1.0, 0.5)
    batches = {name: Batch(ground_model(spec, name), nsim=num, nthread=threads) for name in GROUNDS}
    for name, batch in batches.items():
        _stand(batch, name, place)
    rates: dict[str, list[float]] = {name: [] for name in GROUNDS}
    for _ in range(blocks):
        noise = rng.standard_normal((20, num, spec.num_joints))
        for name, batch in batches.items():
            targets, standing = batch.bind("ctrl"), spec.joint_values("standing")
            start = time.perf_counter()
            for step in noise:
                targets[:] = standing + 0.5 * spec.action_scale * step
                batch.step(nstep=4)
            rates[name].append(len(noise) * num / (time.perf_counter() - start))
    medians = {name: float(np.median(values)) for name, values in rates.items()}
    paired = {name: np.array(rates[name]) / np.array(rates["plane"]) for name in GROUNDS}
    return {
        "control_steps_per_second": medians,
        "over_plane": {name: float(np.median(ratio)) for name, ratio in paired.items()},
        "spread": {name: [float(ratio.min()), float(ratio.max())] for name, ratio in paired.items()},
    }


def _stand(batch: Batch, ground: str, place: np.ndarray) -> None:
    """Put every robot onto the highest ground under its trunk, standing."""
    batch.reset(np.arange(len(place)), keyframe=0)
    pose = batch.bind("qpos")
    pose[:, :2] = place
    if ground != "plane":
        along = place[:, :1] + np.array([-0.4, -0.2, 0.0, 0.2, 0.4])
        under = np.stack((along, np.zeros_like(along)), -1)
        pose[:, 2] += stair_height(under, np.full((len(place), 1), STEP)).max(axis=1) + 0.01
