"""A proposed range of joint friction as other people's training frameworks draw it: a term to paste, and its traps.

What is proposed are shares of each joint's torque limit, so that the limits must be known: of a robot, or of the joints
that were identified. Joints with one limit make one term. The frameworks differ in what their `friction` means, and
whoever takes a number from one to the other trains other physics; each text says what it means there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from stiction.core.decode import is_number
from stiction.core.effects import requirement
from stiction.core.errors import ConfigurationError, FileError
from stiction.exchange.mujoco import SOLIMP
from stiction.exchange.physics import Conversion, Which, number, one_line
from stiction.robots.physics import LEAST_ITERATIONS, LEAST_LS_ITERATIONS


@dataclass(frozen=True)
class FrictionRange:
    """Dry friction to draw for joints that have the same one."""

    joints: tuple[str, ...]
    """Their names in the robot's model."""
    low: float
    """At rest [N m]."""
    high: float
    """At rest [N m]."""


@dataclass(frozen=True)
class Recipe:
    """What is written."""

    ranges: tuple[FrictionRange, ...]
    """In the order of the joints."""
    together: bool
    """Whether one random number a robot is for all its joints; else one each."""
    moving: tuple[float, float]
    """Friction in motion over friction at rest [-], lowest and highest; 1 where they were not identified apart."""
    alone: float
    """Friction of a place with one number over friction at rest [-]."""
    notes: tuple[str, ...]
    """What the range rests on."""


def recipe_of(training: Mapping[str, Any], limits: Mapping[str, float], which: Which = "moving") -> Recipe:
    """Return the ranges of a `training.json` for joints with these torque limits.

    training: as `files.joints.read_training` returns it; limits: name of a joint -> its torque limit [N m]; which:
    friction of a place with one number.
    Raises `FileError` where the proposal has no range, or is not of friction in newton metres.
    """
    friction, span = training["friction"], training.get("range")
    law = friction.get("law", "coulomb")
    if law not in ("coulomb", "stribeck"):
        raise FileError(f"the proposal is of the friction law {law!r}, of which no framework has a term; use coulomb")
    pair = isinstance(span, list) and len(span) == 2 and all(map(is_number, span))
    if not (isinstance(span, list) and pair and 0 <= span[0] <= span[1] < 1):
        raise FileError(f"'range' is {span!r}; expected two shares of the torque limit, from 0 to below 1")
    low, high = span
    if high == 0:
        raise FileError(
            f"method {friction['method']} proposes no friction to draw, and a range of 0 would erase what the model's "
            "joints have; leave that as it is, or convert the values of joints.json"
        )
    groups: dict[float, list[str]] = {}
    for name, limit in limits.items():
        groups.setdefault(limit, []).append(name)
    ranges = tuple(FrictionRange(tuple(names), low * limit, high * limit) for limit, names in groups.items())
    ends = friction.get("static_ratio", ())
    pair = isinstance(ends, list) and len(ends) == 2 and all(map(is_number, ends)) and 1 <= ends[0] <= ends[1]
    if law == "stribeck" and not pair:
        raise FileError(f"'friction.static_ratio' is {ends!r}; expected the lowest and the highest, from 1 on")
    # No more than what is drawn, where the joint has a larger ratio than training takes.
    one = max(_moving(training), 1.0 / ends[1]) if pair else _moving(training)
    moving = (1.0 / ends[1], 1.0 / ends[0]) if pair else (one, one)
    told = f"breakaway over moving: {1 / one:.3g}" if one < 1 else ""
    if told:
        told += "; a place with one number gets friction " + (
            "in motion (--friction static: at rest)" if which == "moving" else "at rest, and is braked by too much"
        )
    said = (
        f"written by `stiction convert`: method {friction['method']}, {100 * low:g} to {100 * high:g} % of each "
        f"joint's torque limit{' at rest' if told else ''}",
        told,
        str(training.get("text", "")),
    )
    together = friction.get("per", "robot") == "robot"
    notes = tuple(one_line(text) for text in said if text)
    return Recipe(ranges, together, moving, one if which == "moving" else 1.0, notes)


def _moving(training: Mapping[str, Any]) -> float:
    """Return friction in motion over that at rest of the joint that sets the level; 1 where they are not told apart."""
    joints = training.get("joints")
    known = [one for one in joints.values() if isinstance(one, dict)] if isinstance(joints, dict) else []
    worst = max(
        known, key=lambda one: one["friction_level"] if is_number(one.get("friction_level")) else 0.0, default={}
    )
    ratios = [worst.get(name) for name in ("friction_ratio", "dynamic_ratio")]
    rest, motion = (ratio.get("value", 0.0) if isinstance(ratio, dict) else 0.0 for ratio in ratios)
    return motion / rest if is_number(rest) and is_number(motion) and 0 < motion <= rest else 1.0


def randomization_term(recipe: Recipe, to: str, assumed_load: float | None = None) -> Conversion:
    """Return Python that draws the friction in a framework at each reset; to: one of `FRAMEWORKS`.

    assumed_load: |F| + |T| that the joints transmit [N + N m], for the engines whose joint friction is a coefficient.
    Raises `ConfigurationError` where the load would be ignored.
    """
    if assumed_load is not None and to not in ("isaaclab", "legged_gym"):
        raise ConfigurationError(requirement("--assumed-load", "--to isaaclab or legged_gym"))
    traps, lines = FRAMEWORKS[to](recipe, assumed_load)
    notes = [*recipe.notes, *traps]
    text = "\n".join([*(f"# {note}" for note in notes), "", *lines]) + "\n"
    return Conversion(text, {name: name for span in recipe.ranges for name in span.joints}, tuple(notes))


Written = tuple[list[str], list[str]]
"""Traps of a framework, and lines of code."""


def _ends(low: float, high: float) -> str:
    """Return a range in Python."""
    return f"({number(low)}, {number(high)})"


def _table(recipe: Recipe, factor: float) -> list[str]:
    """Return a line for each joint with `factor` times its range, in Python."""
    return [
        f"    {name!r}: {_ends(factor * span.low, factor * span.high)},"
        for span in recipe.ranges
        for name in span.joints
    ]


def _isaaclab(recipe: Recipe, assumed_load: float | None) -> Written:
    """Return traps and lines for Isaac Lab."""
    traps = [
        "from Isaac Sim 5 (PhysX 5.6) joint friction is an effort [N m]; before, it is a coefficient of the load "
        "|F| + |T| that the joint transmits, and these numbers would mean something else"
        if assumed_load is None
        else f"coefficients for PhysX before 5.6, right at a load |F| + |T| of {number(assumed_load)} alone; from "
        "Isaac Sim 5 on joint friction is an effort [N m]: convert again without --assumed-load",
        "not by mdp.randomize_joint_parameters: on PhysX it draws dynamic friction apart from the static one, and "
        "viscous friction [N m s/rad] from the range of the dry one",
        "an actuator's own friction and dynamic_friction are replaced at reset; its viscous friction stays",
        "on Newton (Isaac Lab 3) set NEWTON: it has one dry friction for rest and motion, as MuJoCo's row",
    ]
    # A coefficient is one number.
    moving = recipe.moving if assumed_load is None else (1.0, 1.0)
    draw = "len(env_ids), 1" if recipe.together else "len(env_ids), len(joint_ids)"
    return traps, [
        "import re",
        "",
        "import torch",
        "from isaaclab.managers import EventTermCfg",
        "from isaaclab.utils import configclass",
        "",
        f"FRICTION = {{  # [{'N m' if assumed_load is None else '1'}]",
        *_table(recipe, 1.0 if assumed_load is None else recipe.alone / assumed_load),
        "}",
        f"MOVING = {_ends(*moving)}  # friction in motion over that at rest",
        "NEWTON = False",
        "",
        "",
        "def draw_joint_friction(env, env_ids, asset_name='robot'):",
        '    """Draw dry friction at rest, and its share in motion, for the robots that are reset."""',
        "    asset = env.scene[asset_name]",
        "    if env_ids is None:",
        "        env_ids = torch.arange(env.scene.num_envs, device=asset.device)",
        "    names = [re.escape(name) for name in FRICTION]",
        # By default they come in the order of the asset, and a joint would get the range of another one.
        "    joint_ids, _ = asset.find_joints(names, preserve_order=True)",
        "    low, high = torch.tensor(list(FRICTION.values()), device=asset.device).unbind(-1)",
        f"    friction = low + (high - low) * torch.rand({draw}, device=asset.device)",
        f"    share = MOVING[0] + (MOVING[1] - MOVING[0]) * torch.rand({draw}, device=asset.device)",
        *(
            ["    if NEWTON:", "        friction = share * friction"]
            if recipe.alone < 1 and assumed_load is None
            else []
        ),
        "    newer = getattr(asset, 'write_joint_friction_coefficient_to_sim_index', None)",
        "    write = newer or asset.write_joint_friction_coefficient_to_sim",
        "    moving = {} if NEWTON else {'joint_dynamic_friction_coeff': share * friction}",
        "    write(joint_friction_coeff=friction, joint_ids=joint_ids, env_ids=env_ids, **moving)",
        "",
        "",
        "@configclass",
        "class FrictionEvents:",
        '    """Mix it into the events of the environment."""',
        "",
        "    joint_friction = EventTermCfg(func=draw_joint_friction, mode='reset')",
    ]


def _coefficient(recipe: Recipe, load: float) -> Written:
    """Return traps and lines for Isaac Gym's own joint friction under a load |F| + |T| [N + N m]."""
    traps = [
        "Isaac Gym's dof friction is a coefficient of the load that the joint transmits: right at a load "
        f"|F| + |T| of {number(load)} alone",
        "it is drawn once a robot, when it is made; call it from _process_dof_props",
    ]
    return traps, [
        "import numpy as np",
        "",
        "FRICTION = {  # [1]",
        *_table(recipe, recipe.alone / load),
        "}",
        "",
        "",
        "def draw_friction(props, names):",
        '    """Write drawn friction into the properties of one robot\'s joints."""',
        f"    one = {'np.random.uniform()' if recipe.together else 'None'}",
        "    for index, name in enumerate(names):",
        "        if name in FRICTION:",
        "            low, high = FRICTION[name]",
        "            share = np.random.uniform() if one is None else one",
        "            props['friction'][index] = low + share * (high - low)",
        "    return props",
    ]


def _legged_gym(recipe: Recipe, assumed_load: float | None) -> Written:
    """Return traps and lines for legged_gym: friction taken off the motor's torque, or the engine's coefficient."""
    if assumed_load is not None:
        return _coefficient(recipe, assumed_load)
    traps = [
        "Isaac Gym's dof friction is a coefficient of the load on the joint, not N m (--assumed-load writes it); so "
        "friction is taken off the motor's torque here, after it was clipped; rewards of torque then see what is left",
        "this does not hold a joint at rest: below EPSILON it is viscous, and the joint creeps at EPSILON times torque "
        "over friction; the deployed policy sees less of it than PhysX 5.6, MuJoCo or the robot would show",
        "it is explicit: keep EPSILON above friction times the physics step over the joint's inertia, or it chatters",
    ]
    share = (
        "torch.rand(len(env_ids), 1, device=self.device)"
        if recipe.together
        else "torch.rand(len(env_ids), self.num_dof, device=self.device)"
    )
    return traps, [
        "import torch",
        "",
        "FRICTION = {  # [N m]",
        *_table(recipe, recipe.alone),
        "}",
        "",
        "EPSILON = 0.1",
        '"""Speed under which friction fades [rad/s]."""',
        "",
        "",
        "class DryFriction:",
        '    """Mix it in before LeggedRobot: class Robot(DryFriction, LeggedRobot)."""',
        "",
        "    def _init_buffers(self):",
        "        super()._init_buffers()",
        "        ends = [FRICTION.get(name, (0.0, 0.0)) for name in self.dof_names]",
        "        self.friction_ends = torch.tensor(ends, device=self.device)",
        "        self.friction = torch.zeros(self.num_envs, self.num_dof, device=self.device)",
        "        self._draw_friction(torch.arange(self.num_envs, device=self.device))",
        "",
        "    def _draw_friction(self, env_ids):",
        "        low, high = self.friction_ends.unbind(-1)",
        f"        self.friction[env_ids] = low + (high - low) * {share}",
        "",
        "    def reset_idx(self, env_ids):",
        "        super().reset_idx(env_ids)",
        "        if len(env_ids) and hasattr(self, 'friction'):",
        "            self._draw_friction(env_ids)",
        "",
        "    def _compute_torques(self, actions):",
        "        torques = super()._compute_torques(actions)",
        "        return torques - self.friction * torch.tanh(self.dof_vel / EPSILON)",
    ]


def _mujoco(recipe: Recipe, _: float | None) -> Written:
    """Return traps and lines for plain MuJoCo."""
    traps = [
        "MuJoCo's friction is soft: solref and solimp are set with it, or the joint creeps; they suit one timestep",
        "integrate with implicitfast; damping is another thing, and stays as it is",
    ]
    share = "one" if recipe.together else "rng.uniform()"
    return traps, [
        "FRICTION = {  # [N m]",
        *_table(recipe, recipe.alone),
        "}",
        "",
        "",
        "def draw_friction(model, rng):",
        '    """Write drawn friction into an MjModel; rng: numpy.random.Generator."""',
        *(["    one = rng.uniform()"] if recipe.together else []),
        "    for name, (low, high) in FRICTION.items():",
        "        dof = model.joint(name).dofadr[0]",
        f"        model.dof_frictionloss[dof] = low + {share} * (high - low)",
        "        model.dof_solref[dof] = [2 * model.opt.timestep, 1]",
        f"        model.dof_solimp[dof] = {list(SOLIMP)}",
        "    # With less of a line search, loaded joints slip below their friction.",
        f"    model.opt.iterations = max(model.opt.iterations, {LEAST_ITERATIONS})",
        f"    model.opt.ls_iterations = max(model.opt.ls_iterations, {LEAST_LS_ITERATIONS})",
    ]


FRAMEWORKS: dict[str, Callable[[Recipe, float | None], Written]] = {
    "isaaclab": _isaaclab,
    "legged_gym": _legged_gym,
    "mujoco": _mujoco,
}
"""Where a range can be written to; for mjlab see `exchange/mjlab`."""
