"""Configuration of the task: commands, rewards, randomisation. No torch, no mujoco."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

from stiction.core.effects import all_of, needs
from stiction.core.errors import ConfigurationError
from stiction.core.flags import FLAG, flag
from stiction.files.observation import HISTORY_LENGTH, GaitClock, ObservationLayout, proprioception
from stiction.joints.friction import has_coefficient
from stiction.joints.net import ActuatorNet
from stiction.robots.model import DELAY_SAMPLES, Robot
from stiction.robots.physics import CONTACT_TIME, PhysicsCfg
from stiction.task.friction import FrictionCfg
from stiction.task.rewards import RewardCfg
from stiction.task.terrain import TerrainCfg

UNEVEN = "--terrain slopes, rough, stairs or mixed"
"""Required option of settings of the ground."""

LONGEST_HISTORY = 200

SHORTEST_STEP, MOST_STEPS = 1e-5, 1000
"""Minimum physics step [s], and maximum number in a control period: beyond, seconds take days to simulate."""

LONGEST_EPISODE = 3600.0
"""Maximum length of an episode [s]; 20 s is common."""

MOST_CLIP = 1000.0
"""Maximum bound of an action; scaled, it is far beyond any joint."""

SLOWEST = 20.0
"""Maximum time constant of slow means [s]: an episode."""


def check_spans(owner: object, lowest: dict[str, float]) -> None:
    """Raise `StictionError` for ranges with swapped ends, or below the bound of the field in `lowest`."""
    for name, least in lowest.items():
        low, high = getattr(owner, name)
        if not least <= low <= high < float("inf"):
            begin = "" if least == float("-inf") else f" from {least:g} on"
            raise ConfigurationError(
                f"{name} is the range {low:g} to {high:g}; expected two numbers{begin}, the lower one first"
            )


NOT_NEGATIVE = ("damping", "ground_friction", "action_delay", "known_friction")


@dataclass(frozen=True)
class RandomizationCfg:
    """Table II of the paper, and two more rows shared by all methods. Drawn uniformly at each reset."""

    armature: tuple[float, float] = (0.8, 1.2)
    """Multiplier of each joint's rotor inertia."""
    damping: tuple[float, float] = (0.8, 1.2)
    """Multiplier of each joint's viscous friction. kd is not randomised: it acts as B does (section V of the paper)."""
    stiffness: tuple[float, float] = (0.95, 1.05)
    """Multiplier of each joint's kp."""
    motor_strength: tuple[float, float] = (0.8, 1.2)
    """Multiplier k_motor of each joint's commanded torque; the torque limit stays."""
    ground_friction: tuple[float, float] = (0.2, 2.0)
    """Multiplier of the sliding friction coefficient, whose nominal value is 1."""
    contact_time: Annotated[tuple[float, float], FLAG] = (CONTACT_TIME, CONTACT_TIME)
    """Time constant of the contact of feet and ground [s]; shorter is stiffer, down to two physics steps. Not in the
    paper. A light robot trained only on soft ground runs too fast on hard ground."""
    payload: tuple[float, float] = (-2.0, 3.0)
    """Mass added to the trunk [kg], at its centre of mass."""
    center_of_mass: tuple[float, float] = (-0.25, 0.25)
    """Shift of the trunk's centre of mass forward [m], for a trunk as long as that of the paper's robot; sideways, up,
    and on other trunks in proportion."""
    center_of_mass_axes: Literal["all", "forward"] = field(
        default="all",
        metadata=needs("--set task.randomization.center_of_mass other than 0", lambda cfg: any(cfg.center_of_mass)),
    )
    """Axes of that shift: all three, or forward and back alone; the paper's table has one range and names no axis."""
    push_interval: float = field(
        default=8.0, metadata=needs("--set task.randomization.push_velocity above 0", lambda cfg: cfg.push_velocity > 0)
    )
    """Time between pushes [s]; 0 for none."""
    push_velocity: float = 1.0
    """Maximum velocity added to the base by a push, in each horizontal direction [m/s]."""
    action_delay: tuple[float, float] = (0.0, 0.02)
    """Delay between command and motor [s], in whole physics steps, one for all joints of a robot. Not in the paper."""
    encoder_offset: tuple[float, float] = (-0.02, 0.02)
    """Error of each joint's measured angle [rad]; the joint controller sees it too. Not in the paper's table."""
    standing_start: float = 0.0
    """Share of episodes that begin exactly in the standing pose and at rest, as a robot does; in the others every angle
    and velocity has an initial error. Not in the paper."""
    known_friction: tuple[float, float] = field(default=(0.7, 1.3), metadata=needs("--task.known-friction"))
    """Multiplier of the friction that a policy is given, one per kind of joint: the error of its identification, and
    its change since."""

    def __post_init__(self) -> None:
        """Reject multipliers that reverse physics."""
        positive = dict.fromkeys(("armature", "stiffness", "motor_strength", "contact_time"), 1e-3)
        free = dict.fromkeys(("payload", "center_of_mass", "encoder_offset"), float("-inf"))
        check_spans(self, positive | dict.fromkeys(NOT_NEGATIVE, 0.0) | free)
        if not 0 <= self.standing_start <= 1:
            raise ConfigurationError(f"standing_start is {self.standing_start}; expected a share, 0 to 1")
        if not (self.push_interval >= 0 and self.push_velocity >= 0):
            raise ConfigurationError(
                f"push every {self.push_interval} s with {self.push_velocity} m/s: expected at least 0"
            )

    def check_robot(self, robot: Robot) -> None:
        """Raise `StictionError` where a negative payload exceeds the robot's trunk."""
        if robot.base.mass + self.payload[0] <= 0:
            raise ConfigurationError(
                f"payload down to {self.payload[0]} kg on a trunk of {robot.base.mass} kg leaves no mass; "
                "raise the lower end of --set task.randomization.payload"
            )

    def with_net(self, holds_friction: bool) -> RandomizationCfg:
        """Return the randomisation with an Actuator Net, which may include viscous friction."""
        unit, none = (1.0, 1.0), (0.0, 0.0)
        return replace(self, stiffness=unit, action_delay=none, damping=unit if holds_friction else self.damping)

    @classmethod
    def literal(cls) -> RandomizationCfg:
        """Return the paper's table and nothing else; for noise of measurements see `NoiseCfg`."""
        return cls(action_delay=(0.0, 0.0), encoder_offset=(0.0, 0.0))


@dataclass(frozen=True)
class NoiseCfg:
    """Half-width of the uniform noise on each measured quantity, in its unit."""

    angular_velocity: float = 0.1
    """Noise of the base's angular velocity [rad/s]."""
    roll_pitch: float = 0.02
    """Noise of the base's roll and pitch [rad]."""
    joint_position: float = 0.01
    """Noise of each joint angle [rad]."""
    joint_velocity: float = 0.5
    """Noise of each joint velocity [rad/s]."""


@dataclass(frozen=True)
class CommandCfg:
    """Velocity commands in the base frame."""

    forward: tuple[float, float] = (-0.8, 0.8)
    """Range of the velocity along x [m/s]."""
    sideways: tuple[float, float] = (-0.3, 0.3)
    """Range of the velocity along y [m/s]."""
    turn: tuple[float, float] = (-0.6, 0.6)
    """Range of the rate about z [rad/s]."""
    standing_share: float = 0.1
    """Share of commands to stand."""
    interval: float = 5.0
    """Time between new commands [s]."""
    moving_above: float = 0.1
    """Minimum norm (m/s and rad/s alike) of a moving command."""

    def __post_init__(self) -> None:
        """Validate ranges, shares and times."""
        check_spans(self, dict.fromkeys(("forward", "sideways", "turn"), float("-inf")))
        if not (0 <= self.standing_share <= 1 and self.interval > 0):
            raise ConfigurationError(
                f"commands with standing_share {self.standing_share}, new commands every {self.interval} s: expected "
                "a share in [0, 1] and a positive time"
            )


@dataclass(frozen=True)
class TaskCfg:
    """Settings of the task, velocity tracking."""

    robot: Annotated[str, flag("--robot")] = "saturn_lite"
    """Shipped robot, robot.yaml, MuJoCo or URDF file, or package.module:ROBOT."""
    timestep: float = 0.005
    """Physics step [s]."""
    decimation: int = 4
    """Physics steps in one control period."""
    episode: float = 20.0
    """Length of an episode [s]."""
    terrain: TerrainCfg = field(default_factory=TerrainCfg, metadata=needs(UNEVEN, but=("kind",)))
    friction: FrictionCfg = field(default_factory=FrictionCfg)
    physics: PhysicsCfg = field(
        default_factory=PhysicsCfg,
        metadata=needs("friction in training", lambda cfg: cfg.friction.has_friction, ("impedance", "stiffness")),
    )
    randomization: RandomizationCfg = field(
        default_factory=RandomizationCfg,
        metadata=all_of(
            needs("pushes within an episode, by push_interval", lambda cfg: cfg.is_pushed, ("push_velocity",)),
            needs(
                "a control period or more, or 0",
                lambda cfg: cfg.push_steps > 0 or cfg.randomization.push_interval == 0,
                ("push_interval",),
            ),
        ),
    )
    noise: NoiseCfg = field(default_factory=NoiseCfg)
    commands: CommandCfg = field(
        default_factory=CommandCfg,
        metadata=needs("a standing_share below 1", lambda cfg: cfg.is_commanded, but=("standing_share",)),
    )
    rewards: RewardCfg = field(default_factory=RewardCfg)
    action_clip: float = 5.0
    """Bound of an action before scaling."""
    history: int = HISTORY_LENGTH
    """Frames in o_H, the present one included, one per control period. The paper's H of 10 is eleven frames; with more
    a student looks further back."""
    estimated_friction: bool = False
    """True if o_exp, which the policy estimates from its history, includes the dry friction of each kind of joint, in
    units of 0.1 of the torque limit: supervised learning finds it long before a policy's reward would."""
    known_friction: Annotated[bool, FLAG] = field(
        default=False,
        metadata=needs("--friction-law coulomb or stribeck", lambda cfg: not has_coefficient(cfg.friction.law)),
    )
    """True if the policy is given f/τ_max of each kind of joint: in training the robot's, with an error drawn for every
    episode (task.randomization.known_friction), on the robot the identified one (`export --joints`)."""
    first_side: bool = False
    """True if the policy is given the side that begins: 1 or -1, drawn for every episode, and 1 on the robot. Without
    it a symmetric policy, as of --symmetry network, has no first step from a symmetric pose."""
    slow_means: Annotated[float | None, FLAG] = None
    """Time constant [s] of means, of products of target, angle and velocity, that reveal each joint's dry friction
    better than single frames, for example 1. They are in every frame; by default there are none."""

    def __post_init__(self) -> None:
        """Reject inconsistent times and contradicting settings."""
        if not 1 <= self.history <= LONGEST_HISTORY:
            raise ConfigurationError(f"a history of {self.history} frames: expected 1 to {LONGEST_HISTORY}")
        if self.slow_means is not None and not self.control_period <= self.slow_means <= SLOWEST:
            raise ConfigurationError(
                f"slow means over {self.slow_means} s: expected from one control period, {self.control_period} s, to "
                f"{SLOWEST:g} s"
            )
        if self.known_friction and not self.friction.draws_law:
            raise ConfigurationError(
                f"known_friction with the method {self.friction.method!r}: there is no friction in training of which a "
                "policy could be told; use another --method"
            )
        fine = SHORTEST_STEP <= self.timestep <= 0.02 and 1 <= self.decimation <= MOST_STEPS
        if not (fine and self.control_period <= self.episode <= LONGEST_EPISODE):
            raise ConfigurationError(
                f"physics step {self.timestep} s, decimation {self.decimation}, episode {self.episode} s: "
                f"expected a step in [{SHORTEST_STEP:g}, 0.02], a decimation of 1 to {MOST_STEPS}, an episode of a "
                f"control period or more and at most {LONGEST_EPISODE:g} s"
            )
        if not 0 < self.action_clip <= MOST_CLIP:
            raise ConfigurationError(f"action_clip is {self.action_clip}; expected more than 0, at most {MOST_CLIP:g}")
        longest = DELAY_SAMPLES * self.timestep
        if self.randomization.action_delay[1] > longest:
            raise ConfigurationError(
                f"action delay up to {self.randomization.action_delay[1]} s: at steps of {self.timestep} s the "
                f"model holds delays up to {longest:g} s; use a longer step or a shorter delay"
            )

        softness = self.randomization.contact_time
        if softness != (CONTACT_TIME, CONTACT_TIME) and softness[0] < 2 * self.timestep:
            raise ConfigurationError(
                f"contact time from {softness[0]} s: at steps of {self.timestep} s the simulator makes contacts no "
                f"stiffer than {2 * self.timestep:g} s; use a shorter step or a longer contact time"
            )

    def check_net(self, net: ActuatorNet, robot: Robot) -> None:
        """Raise `StictionError` for an Actuator Net that does not match the robot, the physics step or the friction."""
        net.check_use(robot.name, robot.joint_names, robot.joint_values("torque_limit"), self.timestep)
        if net.torque_source == "output_side" and self.friction.has_friction:
            raise ConfigurationError(
                f"the Actuator Net is of output-side torque, which contains the joints' friction, and the method "
                f"{self.friction.method!r} would add it again; use --method none, or a net of motor-side torque"
            )

    def layout(self, robot: Robot) -> ObservationLayout:
        """Return the observation of a policy for a robot."""
        kinds = len(robot.joint_kinds) if self.known_friction else 0
        decay = None if self.slow_means is None else math.exp(-self.control_period / self.slow_means)
        period = robot.gait_period
        clock = None if period is None else GaitClock(period, tuple(robot.foot_phases.tolist()))
        return proprioception(robot.num_joints, self.history, kinds, decay, self.first_side, clock)

    @property
    def push_steps(self) -> int:
        """Control periods between two pushes; 0: never."""
        return round(self.randomization.push_interval / self.control_period)

    @property
    def is_pushed(self) -> bool:
        """True if an episode has a push."""
        return 0 < self.push_steps < round(self.episode / self.control_period)

    @property
    def is_commanded(self) -> bool:
        """True if any robot is commanded to move; False on flat ground where all are told to stand."""
        return self.commands.standing_share < 1 or self.terrain.kind != "flat"

    @property
    def control_period(self) -> float:
        """Time between two actions [s]."""
        return self.timestep * self.decimation
