"""Reward: pure functions of a snapshot of the robots, and the weight of each. No torch before a term is called.

A new term is a function here and a field of `RewardCfg`; a custom one is named in `RewardCfg.own` without a change of
the package.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Annotated

from stiction.core.errors import ConfigurationError
from stiction.core.flags import FLAG
from stiction.core.plugins import find_named
from stiction.robots.model import Robot

if TYPE_CHECKING:
    import torch

LINEAR_SCALE = 0.1
"""Width of the linear tracking reward [m²/s²]: an error of 0.1 m/s still pays 90 %, standing at 0.5 m/s 8 %."""

ANGULAR_SCALE = 0.25
"""Width of the angular tracking reward [rad²/s²]."""

AIR_TIME = (0.15, 0.35)
"""Range of swing times in which the air-time reward grows [s]."""


@dataclass
class Snapshot:
    """Inputs of the rewards, for N robots after one control period."""

    command: torch.Tensor
    """Commanded vx, vy [m/s] and yaw rate [rad/s], (N, 3)."""
    moving: torch.Tensor
    """True where the command is to move, (N,) bool."""
    linear_velocity: torch.Tensor
    """Base velocity in the base frame [m/s], (N, 3)."""
    angular_velocity: torch.Tensor
    """Base rates in the base frame [rad/s], (N, 3)."""
    up: torch.Tensor
    """World's up axis in the base frame, (N, 3)."""
    height_error: torch.Tensor
    """Height of the base minus its standing height [m], (N,)."""
    torque_share: torch.Tensor
    """Motor torque over its limit, (N, J)."""
    joint_deviation: torch.Tensor
    """Joint angles minus the standing pose [rad], (N, J)."""
    sideways_deviation: torch.Tensor
    """The same for joints that move a leg sideways or turn it [rad], (N, S)."""
    joint_acceleration: torch.Tensor
    """Change of joint velocity over the control period [rad/s²], (N, J)."""
    action_change: torch.Tensor
    """Action minus the one before, (N, J)."""
    contact: torch.Tensor
    """True for each foot that carries load, (N, feet) bool."""
    one_group: torch.Tensor
    """r_trot, (N,) bool."""
    unsync: torch.Tensor
    """r_unsync as a share of its maximum, (N,)."""
    in_stance: torch.Tensor
    """True for feet that the gait clock has on the ground, (N, feet) bool; all False without a clock."""
    landed_air_time: torch.Tensor
    """Time in the air of each foot that touches down in this step [s], 0 for the others, (N, legs)."""
    fallen: torch.Tensor
    """True where the robot fell in this step, (N,) bool."""
    blown_up: torch.Tensor
    """True where the simulation diverged in this step, with a reset: its other values are meaningless, (N,) bool."""


Term = Callable[[Snapshot], "torch.Tensor"]
"""Reward of one term for each robot, before its weight, shape (N,)."""


@dataclass(frozen=True)
class RewardCfg:
    """Weight of each reward term, per second. Tuned without friction in the joints, the same for every method.

    A field is the weight of the function of its name in this module; they are added up in this order.
    """

    track_linear: float = 2.0
    """exp(-|v - v*|² / 0.1) of the horizontal velocity."""
    track_angular: float = 0.8
    """exp(-(ω - ω*)² / 0.25) of the yaw rate."""
    trot: float = 1.0
    """r_trot of the paper: exactly one contact group stands, literally. Paid while moving is commanded."""
    unsync: float = -0.6
    """r_unsync of the paper, as a share of its maximum, over the last 100 steps (2 s, as in the public code that the
    paper builds on; the paper does not state its H)."""
    single_stance: Annotated[float, FLAG] = 0.0
    """Exactly one foot stands, while moving is commanded: for a biped in place of r_trot and r_unsync."""
    clock: float = 0.0
    """All feet are on the ground, or off it, as on the gait clock, while moving is commanded: for a biped with a
    `gait_period` in place of single_stance. Zero while standing."""
    air_time: float = 1.0
    """Swing time above 0.15 s, capped at 0.35 s, credited at touch-down, while moving is commanded."""
    vertical_velocity: float = -1.0
    """Square of the base's vertical speed."""
    roll_pitch_rate: float = -0.05
    """Squares of the base's roll and pitch rates."""
    orientation: float = -2.0
    """Squares of the horizontal components of the base's up axis."""
    base_height: float = -10.0
    """Square of the deviation from the standing height."""
    torque: float = -0.05
    """Squares of torque over limit."""
    joint_acceleration: float = -2.5e-7
    """Squares of joint acceleration, over one control period."""
    action_rate: float = -0.01
    """Squares of the change of action."""
    hip_deviation: float = -0.3
    """Squares of the deviation from the standing pose of joints that move a leg sideways or turn it: the hips."""
    stand_still: float = -0.3
    """Distance of all joints from the standing pose, while standing is commanded."""
    fall: float = -20.0
    """Penalty once, when the robot falls (per second like the others: 20 x 0.02 s)."""
    own: Annotated[tuple[tuple[str, float], ...], FLAG] = ()
    """Custom terms and their weights: `package.module:FUNCTION 0.5`, functions of a `Snapshot` like those of
    `stiction.task.rewards`."""

    def for_robot(self, robot: Robot) -> RewardCfg:
        """Return the weights; for a robot without contact groups, default weights become those of its gait.

        It is rewarded for steps by its gait clock, or without one for standing on one foot, in place of a tripod or a
        trot.
        """
        gait = ("trot", "unsync", "single_stance", "clock")
        changed = any(getattr(self, name) != getattr(RewardCfg, name) for name in gait)
        if robot.groups() is not None or changed:
            return self
        plain = replace(self, trot=0.0, unsync=0.0)
        if robot.gait_period is None:
            return replace(plain, single_stance=self.trot)
        return replace(plain, clock=self.trot)

    def terms_for(self, robot: Robot) -> dict[str, tuple[Term, float]]:
        """Return function and weight of every term whose weight is not zero, by the function's name.

        Raises `StictionError` where a custom term cannot be found, or has a name in use, and where the paper's gait is
        requested of a robot without contact groups.
        """
        if robot.groups() is None and (self.trot or self.unsync):
            raise ConfigurationError(
                f"robot {robot.name!r} has no two contact groups, which trot and unsync pay for; give its robot.yaml "
                "groups, or use --set task.rewards.trot=0 --set task.rewards.unsync=0 --task.rewards.single-stance 1"
            )
        if robot.gait_period is None and self.clock:
            raise ConfigurationError(
                f"robot {robot.name!r} has no gait clock, which clock pays for; give its robot.yaml a gait_period"
            )
        names = [field.name for field in fields(self) if field.name != "own"]
        terms = {name: (globals()[name], float(getattr(self, name))) for name in names}
        for place, weight in self.own:
            term = find_named("reward term", place)
            name = getattr(term, "__name__", "")
            if not callable(term) or not name or name in terms:
                raise ConfigurationError(
                    f"reward term {place!r}: expected a function with another name than {', '.join(terms)}"
                )
            terms[name] = (_checked(place, term), float(weight))
        return {name: (term, weight) for name, (term, weight) in terms.items() if weight}


def _checked(place: str, term: Term) -> Term:
    """Return a custom term that reports failures, and results other than one value per robot, in one line."""

    def pay(snapshot: Snapshot) -> torch.Tensor:
        try:
            paid = term(snapshot)
            shape = tuple(paid.shape)
        # Whatever code of others raises.
        except Exception as error:
            raise ConfigurationError(
                f"reward term {place!r} fails with {type(error).__name__}: {error}; expected a function that takes a "
                "Snapshot and returns a tensor; correct it (--debug shows where), or leave it out"
            ) from error
        if shape != (expected := (len(snapshot.command),)):
            raise ConfigurationError(
                f"reward term {place!r} returns a tensor of shape {shape}; expected {expected}, one value per robot"
            )
        return paid

    return pay


TASK = ("track_linear", "track_angular")
"""Terms of the task, to follow the command; all others shape the gait. Each is at most 1."""


def best_task_reward(terms: Mapping[str, tuple[Term, float]]) -> float:
    """Return the maximum task reward per second (perfect tracking) [1/s]; `terms`: as of `RewardCfg.terms_for`."""
    return sum(weight for name, (_, weight) in terms.items() if name in TASK and weight > 0)


def track_linear(s: Snapshot) -> torch.Tensor:
    """Return exp(-|v_xy - v*_xy|² / scale)."""
    return (-(s.command[:, :2] - s.linear_velocity[:, :2]).square().sum(-1) / LINEAR_SCALE).exp()


def track_angular(s: Snapshot) -> torch.Tensor:
    """Return exp(-(ω_z - ω*_z)² / scale)."""
    return (-(s.command[:, 2] - s.angular_velocity[:, 2]).square() / ANGULAR_SCALE).exp()


def trot(s: Snapshot) -> torch.Tensor:
    """Return r_trot while moving."""
    return (s.one_group & s.moving).float()


def single_stance(s: Snapshot) -> torch.Tensor:
    """Return 1 while exactly one foot carries load and moving is commanded."""
    return ((s.contact.sum(-1) == 1) & s.moving).float()


def clock(s: Snapshot) -> torch.Tensor:
    """Return 1 while every foot is as on the clock, and moving is commanded."""
    return ((s.contact == s.in_stance).all(-1) & s.moving).float()


def unsync(s: Snapshot) -> torch.Tensor:
    """Return r_unsync while moving."""
    return s.unsync * s.moving


def air_time(s: Snapshot) -> torch.Tensor:
    """Return the useful swing time of the feet that touch down, while moving [s]."""
    low, high = AIR_TIME
    # Not clamped from below: a swing that is shorter than `low` costs.
    useful = (s.landed_air_time - low).clamp(max=high - low) * (s.landed_air_time > 0)
    return useful.sum(-1) * s.moving


def vertical_velocity(s: Snapshot) -> torch.Tensor:
    """Return v_z²."""
    return s.linear_velocity[:, 2].square()


def roll_pitch_rate(s: Snapshot) -> torch.Tensor:
    """Return ω_x² + ω_y²."""
    return s.angular_velocity[:, :2].square().sum(-1)


def orientation(s: Snapshot) -> torch.Tensor:
    """Return the squared horizontal part of the up axis."""
    return s.up[:, :2].square().sum(-1)


def base_height(s: Snapshot) -> torch.Tensor:
    """Return (h - h_stand)²."""
    return s.height_error.square()


def torque(s: Snapshot) -> torch.Tensor:
    """Return the sum of (τ / τ_max)²."""
    return s.torque_share.square().sum(-1)


def joint_acceleration(s: Snapshot) -> torch.Tensor:
    """Return the sum of squares."""
    return s.joint_acceleration.square().sum(-1)


def action_rate(s: Snapshot) -> torch.Tensor:
    """Return the sum of squares."""
    return s.action_change.square().sum(-1)


def hip_deviation(s: Snapshot) -> torch.Tensor:
    """Return the sum of squares over the joints that move a leg sideways or turn it."""
    return s.sideways_deviation.square().sum(-1)


def stand_still(s: Snapshot) -> torch.Tensor:
    """Return the sum of |q - q_stand| while standing is commanded."""
    return s.joint_deviation.abs().sum(-1) * ~s.moving


def fall(s: Snapshot) -> torch.Tensor:
    """Return 1 in the step of the fall."""
    return s.fallen.float()
