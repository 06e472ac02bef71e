"""Domain randomisation: the paper's Table II, drawn for a robot at each reset, relative to the *nominal* value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from stiction.core.errors import ConfigurationError, FileError
from stiction.files.joints import ARMATURE, Estimate, JointRecord, JointsFile
from stiction.joints.compensation import BY_SPEED
from stiction.joints.friction import has_coefficient
from stiction.robots.model import TRUNK_LENGTH, Robot
from stiction.robots.physics import CONTACT_TIME
from stiction.sim.fleet import Fleet
from stiction.sim.indexing import assign
from stiction.task.config import RandomizationCfg
from stiction.task.friction import NUMBERS, FrictionCfg, Mixture, friction_share
from stiction.task.task_fleet import HostFleet, TaskFleet

PAYLOAD_UNIT, MULTIPLIER_UNIT, FRICTION_UNIT = 3.0, 0.2, 0.1
"""Units of entries: 3 kg of payload, a multiplier of 1.2, dry friction of 0.1 of the torque limit, in o_priv by default
(`FrictionCfg.privileged_unit`)."""

PRIVILEGED_TERMS = (
    ("payload", "robot"),
    ("ground_friction", "robot"),
    ("armature", "joint"),
    ("damping", "joint"),
    ("friction", "joint"),
)
"""Terms of o_priv, in its order: one entry per robot, or one for each joint."""


def privileged_observation(
    payload: torch.Tensor,
    ground_friction: torch.Tensor,
    armature: torch.Tensor,
    damping: torch.Tensor,
    friction: torch.Tensor,
    friction_unit: float = FRICTION_UNIT,
) -> torch.Tensor:
    """Return o_priv = {m_b, f_g, I_j, B_j, f_j}, shape (N, 2 + 3 joints), each entry near unit size.

    Payload [kg] and multiplier of ground friction, (N, 1); multipliers, and friction over the torque limit, (N,
    joints).
    """
    multipliers = [(value - 1.0) / MULTIPLIER_UNIT for value in (armature, damping)]
    return torch.cat((payload / PAYLOAD_UNIT, ground_friction - 1.0, *multipliers, friction / friction_unit), -1)


def nominal_privileged(friction: np.ndarray, friction_unit: float = FRICTION_UNIT) -> torch.Tensor:
    """Return o_priv, float32, of nominal robots with this friction over the torque limit, (N, joints)."""
    share = torch.from_numpy(np.asarray(friction, dtype=np.float32))
    units, column = torch.ones_like(share), torch.ones(len(share), 1)
    return privileged_observation(0.0 * column, column, units, units, share, friction_unit)


@dataclass(frozen=True)
class NominalJoints:
    """Nominal joint physics, to which multipliers refer, each of shape (joints,)."""

    armature: np.ndarray
    """Rotor inertia [kg m²]."""
    damping: np.ndarray
    """Viscous friction [N m s/rad]."""
    frictionloss: np.ndarray
    """Dry friction [N m]; for the laws `load` and `effort`, the coefficient [-]."""


def nominal_joints(
    fleet: Fleet | TaskFleet, friction: FrictionCfg, identified: dict[str, np.ndarray] | None = None
) -> NominalJoints:
    """Return the robot's joints, overridden by an identification, its friction overridden by the level.

    `identified`: name -> (joints,), NaN where not identified. Raises `ConfigurationError` for an unknown coefficient.
    """
    robot = fleet.spec
    values = {name: robot.joint_values(name) for name in ("armature", "damping", "frictionloss")}
    known = dict(identified or {})
    coefficients = known.pop("load_coefficient", None)
    for name, value in known.items():
        values[name] = np.where(np.isnan(value), values[name], value)
    if has_coefficient(friction.law):
        if friction.level is None and coefficients is None and friction.has_friction:
            raise ConfigurationError(f"the friction law {friction.law!r} has no coefficient; say --friction-level")
        default = 0.0 if coefficients is None else coefficients
        values["frictionloss"] = np.zeros(robot.num_joints) + (default if friction.level is None else friction.level)
    elif friction.level is not None:
        values["frictionloss"] = friction.level * robot.joint_values("torque_limit")
    return NominalJoints(**values)


def friction_angle(cfg: FrictionCfg, nominal: NominalJoints, robot: Robot) -> tuple[float, ...] | None:
    """Return the maximum shift of each joint's target by `compensation` [rad]; None without compensation."""
    if cfg.compensation is None:
        return None
    return tuple((BY_SPEED.share * nominal.frictionloss / robot.joint_values("kp")).tolist())


@dataclass
class Draws:
    """Current parameters of each robot, float32; multipliers unless a unit is given."""

    armature: torch.Tensor
    damping: torch.Tensor
    friction: torch.Tensor
    stiffness: torch.Tensor
    motor_strength: torch.Tensor
    """Multipliers above, each (N, joints)."""
    ground_friction: torch.Tensor
    payload: torch.Tensor
    """Payload [kg]; both (N, 1)."""
    contact_time: torch.Tensor
    """Time constant of contacts [s], (N, 1)."""
    load_coefficient: torch.Tensor
    """Coefficient of friction that grows with load [1], (N, 1)."""
    static_ratio: torch.Tensor
    stribeck_velocity: torch.Tensor
    """Drawn numbers of the friction law [1], [rad/s], (N, 1), or (N, joints) for friction by joint."""
    center_of_mass: torch.Tensor
    """Shift in the base frame [m], (N, 3)."""
    action_delay: torch.Tensor
    """Delay of actions [s], (N, 1)."""
    encoder_offset: torch.Tensor
    """Offset of encoders [rad], (N, joints)."""


class Randomizer:
    """Draw of parameters for a fleet."""

    def __init__(self, fleet: TaskFleet, cfg: RandomizationCfg, friction: FrictionCfg, nominal: NominalJoints) -> None:
        """Start with all draws 0, before the first `draw`."""
        motors = fleet.motors if isinstance(fleet, HostFleet) else None
        if motors is not None:
            cfg = cfg.with_net(motors.holds_friction)
            if motors.holds_friction:
                zero = np.zeros_like(nominal.damping)
                nominal = NominalJoints(nominal.armature, damping=zero, frictionloss=zero)
        self.fleet, self.cfg, self.friction, self.nominal = fleet, cfg, friction, nominal
        self.mixture = friction.schedule[0].mixture
        self._parts: tuple[Mixture, torch.Tensor] = ((), torch.zeros(0, 3))
        self.task_device = task_device = fleet.task_device
        share = friction_share(friction.law, nominal.frictionloss, fleet.spec)
        self.nominal_share = torch.from_numpy(share).float().to(task_device)
        self.load_share = (
            torch.from_numpy(friction_share("load", np.ones_like(share), fleet.spec)).float().to(task_device)
        )
        self.base_mass = fleet.spec.base.mass
        self.base_com = torch.tensor(fleet.spec.base.com, dtype=torch.float64, device=task_device)
        fixed = vars(nominal) | {"kp": fleet.nominal_kp, "kd": fleet.nominal_kd}
        self._fixed = {name: torch.from_numpy(value).double().to(task_device) for name, value in fixed.items()}
        cfg.check_robot(fleet.spec)
        axes = np.array(fleet.spec.base.size) / TRUNK_LENGTH
        axes[1:] *= cfg.center_of_mass_axes == "all"
        self.com_axes = torch.from_numpy(axes).float().to(task_device)
        num, joints = fleet.num_envs, fleet.spec.num_joints
        single = ("ground_friction", "payload", "contact_time", "load_coefficient", "action_delay")
        widths = {"center_of_mass": 3} | dict.fromkeys(single, 1)
        if friction.per == "robot":
            widths |= dict.fromkeys(NUMBERS, 1)
        names = Draws.__dataclass_fields__
        self.draws = Draws(**{name: torch.zeros(num, widths.get(name, joints), device=task_device) for name in names})
        self.draws.contact_time[:] = cfg.contact_time[0]
        for name in NUMBERS:
            getattr(self.draws, name)[:] = getattr(friction.joint_law, name)

    def draw(self, which: torch.Tensor, generator: torch.Generator) -> None:
        """Draw every parameter of the robots `which`, see `sim.indexing`, and write it into the fleet."""
        cfg, num = self.cfg, len(which)

        def uniform(span: tuple[float, float], like: torch.Tensor) -> torch.Tensor:
            return span[0] + (span[1] - span[0]) * torch.rand(
                num, like.shape[1], generator=generator, device=self.task_device
            )

        # Drawn last, and only where they vary: what came to the randomisation later shifts no number of what was there
        # before.
        later = ("friction", "contact_time", "load_coefficient", *NUMBERS)
        drawn = ((name, value) for name, value in vars(self.draws).items() if name not in later)
        new = {name: uniform(getattr(cfg, name), value) for name, value in drawn}
        new["friction"] = self._draw_friction(num, generator)
        if cfg.contact_time[0] < cfg.contact_time[1]:
            new["contact_time"] = uniform(cfg.contact_time, self.draws.contact_time)
        if self.friction.load is not None:
            new["load_coefficient"] = uniform(self.friction.load, self.draws.load_coefficient)
        for name, span in self.friction.drawn_numbers.items():
            new[name] = uniform(span, getattr(self.draws, name))
        new["center_of_mass"] = new["center_of_mass"] * self.com_axes
        step = self.fleet.timestep
        new["action_delay"] = (new["action_delay"] / step).round() * step
        for name, value in new.items():
            assign(getattr(self.draws, name), which, value)
        self.apply(which)

    def _draw_friction(self, num: int, generator: torch.Generator) -> torch.Tensor:
        """Return multipliers of the nominal friction from the stage's mixture, (num, joints)."""
        size = (num, self.draws.friction.shape[1])
        if self._parts[0] != self.mixture:
            # Kept, for on a GPU each new tensor from the host is a wait.
            self._parts = self.mixture, torch.tensor(self.mixture).to(self.task_device)
        weight, low, high = self._parts[1].unbind(-1)
        share = torch.rand(size, generator=generator, device=self.task_device)
        part = torch.zeros(size, dtype=torch.long, device=self.task_device)
        if len(weight) > 1:
            part = torch.multinomial(weight, size[0] * size[1], True, generator=generator).view(size)
        multiplier = low[part] + (high - low)[part] * share
        if self.friction.per == "joint":
            return multiplier
        if self.friction.spread is None:
            return multiplier[:, :1].expand(size)
        least, most = self.friction.spread
        factor = torch.rand(size, generator=generator, device=self.task_device)
        return multiplier[:, :1] * (least + (most - least) * factor)

    def enter(self, mixture: Mixture, generator: torch.Generator) -> None:
        """Enter a stage of the schedule: draw every robot's friction, and nothing else."""
        self.mixture = mixture
        self.draws.friction = self._draw_friction(self.fleet.num_envs, generator).clone()
        self.apply(torch.arange(self.fleet.num_envs, device=self.task_device))

    def apply(self, which: torch.Tensor) -> None:
        """Write the draws of the robots `which` into the fleet, which recomputes the derived constants."""
        every = which.dtype == torch.bool
        drawn = {name: (tensor if every else tensor[which]).double() for name, tensor in vars(self.draws).items()}
        strength, fixed = drawn["motor_strength"], self._fixed
        values = {
            "armature": drawn["armature"] * fixed["armature"],
            "damping": drawn["damping"] * fixed["damping"],
            "frictionloss": drawn["friction"] * fixed["frictionloss"],
            # A motor's strength scales all of its torque, and so both gains.
            "kp": strength * drawn["stiffness"] * fixed["kp"],
            "kd": strength * fixed["kd"],
            "motor_strength": strength,
            "delay": drawn["action_delay"],
            "ground_friction": drawn["ground_friction"],
            "base_mass": self.base_mass + drawn["payload"][:, 0],
            "base_com": self.base_com + drawn["center_of_mass"],
        }
        if self.friction.load is not None:
            values["load_coefficient"] = drawn["load_coefficient"]
        values |= {name: drawn[name] for name in self.friction.drawn_numbers}
        if self.cfg.contact_time != (CONTACT_TIME, CONTACT_TIME):
            values["contact_time"] = drawn["contact_time"]
        self.fleet.set_parameters(values, which)

    def friction_share(self) -> torch.Tensor:
        """Return friction over the torque limit, (N, joints); load friction as in `friction_share`."""
        return self.unloaded_share() + self.draws.load_coefficient * self.load_share

    def unloaded_share(self) -> torch.Tensor:
        """Return the same without additional load friction, as on a bench, shape (N, joints)."""
        return self.draws.friction * self.nominal_share

    def privileged(self) -> torch.Tensor:
        """Return o_priv of every robot, shape (N, 2 + 3 joints); see `privileged_observation`."""
        d, unit = self.draws, self.friction.privileged_unit
        return privileged_observation(d.payload, d.ground_friction, d.armature, d.damping, self.friction_share(), unit)


@dataclass(frozen=True)
class IdentifiedJoints:
    """Identified properties of each joint of a robot; None keeps the robot's value."""

    armature: tuple[float | None, ...]
    """Rotor inertia [kg m²]: the identified inertia minus that of the links in the test."""
    damping: tuple[float | None, ...]
    """Viscous friction [N m s/rad]."""
    frictionloss: tuple[float | None, ...]
    """Coulomb friction [N m]."""
    warnings: tuple[str, ...]


def identified_joints(
    file: JointsFile, joint_names: tuple[str, ...], link_inertia: np.ndarray, torque_limit: np.ndarray
) -> IdentifiedJoints:
    """Read the nominal joints of a robot from an identification.

    A record is for the joint of its name or for all of its kind. The links' inertia [kg m²] is subtracted from one
    measured in the air; the inertia of a loaded or unstated test is not used. Friction in units of the command counts
    as a share of the torque limit [N m]. Raises `StictionError` where nothing can be used, or an inertia is too small.
    """
    rows: list[tuple[float | None, float | None, float | None]] = []
    warnings: dict[str, None] = {}
    for name, links, limit in zip(joint_names, link_inertia, torque_limit, strict=True):
        key = file.key(name)
        record = file.joints[key] if key is not None else JointRecord()
        if record.axis != "rotary":
            raise FileError(f"joint {key!r} was identified as a linear axis (kg, N); expected a rotary one")
        whole, objection = (record.objection_to(quantity) for quantity in ("inertia", "coulomb_friction"))
        if objection is not None:
            part = "nothing of it" if whole is not None else "its dry friction"
            used = "is not used" if whole is None else "is used"
            warnings[f"the fit of {key!r} is not valid, {part} {used}: {objection.text}"] = None
        if whole is not None:
            rows.append((None, None, None))
            continue
        armature = _armature(name, key, record, float(links), warnings)
        friction = None if objection is not None else _friction(key, record, float(limit), warnings)
        rows.append((armature, _value(record.viscous_friction), friction))
    if all(value is None for row in rows for value in row):
        if invalid := next((text for text in warnings if "is not valid" in text), None):
            raise FileError(f"the file holds nothing that can be used: {invalid}")
        raise FileError(
            f"the file has {', '.join(file.joints)}, none of which can be used for {', '.join(joint_names[:3])} and "
            "so on; name the joint, or its kind, when you identify it"
        )
    inertias, dampings, frictions = zip(*rows, strict=True)
    return IdentifiedJoints(inertias, dampings, frictions, tuple(warnings))


def _value(estimate: Estimate | None) -> float | None:
    """Return an estimate of friction, at least zero."""
    return None if estimate is None else max(0.0, estimate.value)


def _friction(key: str | None, record: JointRecord, limit: float, warnings: dict[str, None]) -> float | None:
    """Return the Coulomb friction [N m] of a joint with the torque limit `limit`, from N m or from the ratio."""
    share = record.dynamic_ratio or record.friction_ratio
    if (holding := record.holding_friction) is not None and (moving := record.moving_friction) is not None:
        warnings[
            f"{key!r}: {holding.value:.4g} N m of dry friction at rest, {moving.value:.4g} N m in motion, which alone "
            "is simulated by --friction-law coulomb; --friction-from training.json draws both"
        ] = None
    if record.coulomb_friction is not None or share is None:
        return _value(record.coulomb_friction)
    ratio = max(0.0, share.value)
    warnings[
        f"the friction of {key!r} is known in units of the command only, no torque was measured: {100 * ratio:.3g} % "
        "of the robot's own torque limit is taken, as if the motor had its nominal strength"
    ] = None
    return ratio * limit


def _armature(name: str, key: str | None, record: JointRecord, links: float, warnings: dict[str, None]) -> float | None:
    """Return the rotor inertia of joint `name` from its record, `key`, or None."""
    if (rotor := record.combinations.get(ARMATURE)) is not None and rotor.interval95[0] > 0:
        return rotor.value
    if record.inertia is None:
        return None
    if record.test_condition not in ("bare_motor", "in_air"):
        stated = f"was measured {record.test_condition}" if record.test_condition else "has no test condition"
        warnings[f"the inertia of {key!r} {stated}: it is not used, and the robot's own rotor inertia stays"] = None
        return None
    measured = record.inertia.value
    if measured <= 0:
        raise FileError(f"joint {name!r}: an inertia of {measured:.4g} kg m²; expected a positive number")
    if record.test_condition == "bare_motor":
        return measured
    if measured <= links:
        raise FileError(
            f"joint {name!r}: {measured:.4g} kg m² was measured in the air, and the robot's links alone have "
            f"{links:.4g}; expected more: correct the robot's masses, or identify the bare motor"
        )
    return measured - links
