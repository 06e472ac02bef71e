"""Turns a policy bundle into a Webots project: protos/, worlds/, controllers/, plugins/. Not run in Webots.

The project is made of the robot's `RobotSpec` (shape, masses, limits) and of the bundle's contract (gains, rotor
inertia and viscous friction of the joints, rates). The bundle is checked before it is copied, and the copy after.
"""

from __future__ import annotations

import math
import os
import shutil
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from stiction.deploy.check import check_bundle
from stiction.formats.bundle import Bundle, BundleError, read_bundle
from stiction.formats.contract import Contract
from stiction.formats.errors import StictionError
from stiction.formats.friction import MAX_LEVEL
from stiction.robots.spec import RobotSpec
from stiction.sim.terrain import STEEPEST
from stiction.transfer.rollout import robot_of
from stiction.transfer.webots.controller import PLUGIN
from stiction.transfer.webots.plugin import plugin_files
from stiction.transfer.webots.proto import proto_name, write_proto
from stiction.transfer.webots.readme import write_readme
from stiction.transfer.webots.world import joint_friction, milliseconds, write_world

CONTROLLER = "stiction_policy"
"""Name of the controller's folder and program."""

NOT_RUN = "written and tested short of running; not run in Webots"
"""What everybody is told."""


@dataclass(frozen=True)
class WebotsCfg:
    """What the worlds are like."""

    friction_level: float = 0.0
    """Dry friction of the joints as a fraction of each one's torque limit [-]. None by default: the friction of a world
    is the question that is asked, so it is said and not assumed. Webots has Coulomb's law alone."""
    step_height: float = 0.10
    """Height of the stairs' steps [m]. A policy trained on stairs climbed 12 cm in 92 of 100 trials in MuJoCo, without
    friction (`results/stairs`); this is a little less."""

    def __post_init__(self) -> None:
        """Refuse what is no world."""
        if not 0 <= self.friction_level <= MAX_LEVEL:
            raise StictionError(
                f"friction level {self.friction_level} is outside [0, {MAX_LEVEL}], fractions of the torque limit"
            )
        if not 0 < self.step_height <= STEEPEST["stairs"]:
            raise StictionError(f"step height {self.step_height} m: expected one in (0, {STEEPEST['stairs']}] m")


@dataclass(frozen=True)
class WebotsProject:
    """What was written."""

    path: Path
    """The project's folder."""
    robot: str
    """Name of the robot."""
    bundle: Bundle
    """The bundle within it, as it was checked."""
    cfg: WebotsCfg
    """What the worlds are like."""
    files: tuple[str, ...]
    """Its files, relative, in alphabetical order."""

    def summary(self) -> dict[str, Any]:
        """Return plain data for `--json`."""
        return {
            "path": str(self.path),
            "robot": self.robot,
            "digest": self.bundle.digest,
            "friction_level": self.cfg.friction_level,
            "step_height": self.cfg.step_height,
            "files": list(self.files),
            "state": NOT_RUN,
        }


def export_webots(source: Path, out: Path, cfg: WebotsCfg | None = None, robot: str | None = None) -> WebotsProject:
    """Write the Webots project of a bundle to a folder that does not exist yet, whole or not at all.

    source: directory of the bundle; robot: one of one's own, `package.module:NAME`, by default the bundle's.

    Raises:
        StictionError: the bundle does not pass its checks, does not fit the robot or Webots, or the folder exists.

    """
    cfg = cfg or WebotsCfg()
    if out.exists():
        raise StictionError(f"{out} exists already; choose another --out or remove it")
    bundle = check_bundle(source).bundle
    spec = robot_of(bundle.contract, robot)
    check_fit(spec, bundle.contract)
    partial = out.with_name(f".{out.name}.partial-{os.getpid()}")
    try:
        partial.mkdir(parents=True)
        _write(partial, spec, bundle, source, cfg)
        partial.rename(out)
    except OSError as error:
        raise StictionError(f"the project {out} cannot be written: {error}; choose another --out") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    files = sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())
    return WebotsProject(out, spec.name, bundle, cfg, tuple(files))


def check_fit(spec: RobotSpec, contract: Contract) -> None:
    """Raise `StictionError` where robot and contract differ in what the PROTO takes from one and the controller from
    the other, or where Webots cannot take the contract's physics step: a controller steps in whole milliseconds.
    """
    for field in ("standing", "lower", "upper"):
        if not np.array_equal(spec.joint_values(field), contract.array(field)):
            raise StictionError(
                f"robot {spec.name!r} has another {field} angle of its joints than the bundle; name the right one with "
                "--robot"
            )
    step = milliseconds(contract.physics_timestep)
    if step < 1 or not math.isclose(step, round(step), abs_tol=1e-6):
        raise StictionError(
            f"the policy's physics step is {step:g} ms; a controller in Webots steps in whole milliseconds, so this "
            "bundle cannot be exported there"
        )


def _write(folder: Path, spec: RobotSpec, bundle: Bundle, source: Path, cfg: WebotsCfg) -> None:
    """Write the project's files into an empty folder."""
    contract = bundle.contract
    friction = joint_friction(spec, cfg.friction_level)
    program = resources.files(__package__).joinpath("controller.py").read_text("utf-8")
    texts = {
        "README.md": write_readme(spec, bundle, bundle.name, cfg.friction_level, cfg.step_height),
        f"protos/{proto_name(spec.name)}.proto": write_proto(spec, contract),
        "worlds/flat.wbt": write_world(spec, contract.physics_timestep, friction),
        "worlds/stairs.wbt": write_world(spec, contract.physics_timestep, friction, cfg.step_height),
        f"controllers/{CONTROLLER}/{CONTROLLER}.py": program,
        **{f"plugins/physics/{PLUGIN}/{name}": text for name, text in plugin_files(spec, contract).items()},
    }
    for name, text in texts.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    copy = folder / "controllers" / CONTROLLER / "bundle"
    shutil.copytree(source, copy)
    if read_bundle(copy).digest != bundle.digest:
        raise BundleError(f"{source} changed while it was copied; try again")
