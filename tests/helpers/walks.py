"""Walks of a simulated hexapod whose joint friction is known, logged as `evaluate --log` does."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from stiction.files.bundle import Bundle
from stiction.files.walk import WalkHeader, WalkLog
from stiction.robots.catalog import find_robot

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to have a robot walk")

from stiction.deploy.check import check_bundle
from stiction.deploy.policy import load_policy
from stiction.evaluation.rollout import Rollout
from stiction.evaluation.walk_logs import LogNoiseCfg, measure_walk, record_motion

SPEC = find_robot("saturn_lite")

LIMITS = SPEC.joint_values("torque_limit")
"""Torque limits [N m], shape (18,)."""

ARMATURE, DAMPING = 0.0145, 0.0704
"""The policy's rotor inertia [kg m²] and viscous friction [N m s/rad]."""

FORWARD, CURVE, BACKWARD, SIDEWAYS = (0.5, 0.0, 0.0), (0.3, 0.2, 0.3), (-0.5, 0.0, 0.0), (0.0, 0.3, 0.0)
"""Commands: forward, sideways [m/s], turn [rad/s]."""

NO_NOISE = LogNoiseCfg(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@cache
def walking_bundle() -> Bundle:
    """Return a policy that walks at every friction level and lifts its feet: tests do not change with shipped ones."""
    return check_bundle(Path(__file__).parents[1] / "data" / "walker").bundle


def start(friction: np.ndarray, seed: int = 0) -> Rollout:
    """Return robots with the given dry friction [N m], shape (N, 18), each with a generator of its own."""
    bundle = walking_bundle()
    generators = [np.random.default_rng(seed + index) for index in range(len(friction))]
    policy = load_policy(bundle.contract, bundle.policy, (len(friction),))
    return Rollout(bundle.contract, policy, SPEC, friction, generators)


def header(period: float) -> WalkHeader:
    """Return the header of a log with `period` [s]."""
    contract = walking_bundle().contract
    return WalkHeader(
        robot=contract.robot,
        joint_names=contract.joint_names,
        foot_names=SPEC.foot_names,
        period=period,
        kp=contract.kp,
        kd=contract.kd,
        torque_limit=contract.torque_limit,
        torque_source="motor_side",
        recorded_in="mujoco",
    )


def walk(
    friction: np.ndarray,
    commands: list[tuple[float, float, float]],
    noise: LogNoiseCfg | None = None,
    load: np.ndarray | None = None,
    seconds: float = 10.0,
    seed: int = 0,
) -> list[WalkLog]:
    """Return a log of each robot.

    friction: b [N m], shape (N, 18); load: c of friction b + c |τ| [1], shape (18,), or None for none.
    """
    rollout, contract = start(friction, seed), walking_bundle().contract
    if load is not None:
        add_load_friction(rollout, friction, load)
    truths = record_motion(rollout, contract.array("kd"), np.array(commands), round(seconds / contract.control_period))
    generators = [np.random.default_rng([seed, index]) for index in range(len(truths))]
    return [
        measure_walk(WalkLog(header(contract.physics_timestep), **truth), noise or LogNoiseCfg(), generator)
        for truth, generator in zip(truths, generators, strict=True)
        if truth is not None
    ]


def fast_motion(
    friction: np.ndarray, commands: list[tuple[float, float, float]]
) -> list[tuple[dict[str, np.ndarray], np.random.Generator]]:
    """Return what robots do whose physics and joint controllers run at 1 kHz, each with its generator of noise."""
    bundle = walking_bundle()
    contract = replace(bundle.contract, physics_timestep=0.001, decimation=20)
    generators = [np.random.default_rng(index) for index in range(len(friction))]
    policy = load_policy(contract, bundle.policy, (len(friction),))
    rollout = Rollout(contract, policy, SPEC, friction, generators)
    truths = record_motion(rollout, contract.array("kd"), np.array(commands), 500)
    return [(truth, generator) for truth, generator in zip(truths, generators) if truth is not None]


def sampled(motion: list[tuple[dict[str, np.ndarray], np.random.Generator]], every: int) -> list[WalkLog]:
    """Return logs of what `fast_motion` returned, with one sample in `every`.

    The torque is the mean over the samples that it stands for, the rest is what holds at its own sample.
    """
    logs = []
    for truth, generator in motion:
        length = len(truth["time"]) // every * every
        signals = {name: array[:length:every] for name, array in truth.items()}
        signals["joint_torque"] = truth["joint_torque"][:length].reshape(-1, every, SPEC.num_joints).mean(axis=1)
        logs.append(measure_walk(WalkLog(header(0.001 * every), **signals), LogNoiseCfg(), deepcopy(generator)))
    return logs


def add_load_friction(rollout: Rollout, base: np.ndarray, load: np.ndarray) -> None:
    """Make friction b + c |τ| of the very step's torque, by doing each step until the two agree."""
    fleet, simulation = rollout.fleet, rollout.fleet.simulation
    plain, kd = simulation.step, walking_bundle().contract.array("kd")

    def step(count: int) -> np.ndarray:
        before, velocity = simulation.state(), fleet.joint_velocity.copy()
        for _ in range(3):
            simulation.load_state(before)
            plain(count)
            free = np.abs(fleet.torque) < fleet.torque_limit * (1 - 1e-9)
            torque = fleet.torque - free * kd * (fleet.joint_velocity - velocity)
            fleet.friction[:] = base + load * np.abs(torque)
        simulation.load_state(before)
        return plain(count)

    simulation.step = step


def centre_of_mass() -> tuple[float, float, float]:
    """Return the trunk's centre of mass in the simulated robot [m]."""
    x, y, z = start(np.zeros((1, 18))).fleet.model.body("base").ipos
    return float(x), float(y), float(z)
