"""What was measured when damping moved between viscous friction B and derivative gain kd, as records."""

from __future__ import annotations

from dataclasses import dataclass

FRICTION, EFFORT, LIMIT = "dry friction", "friction by effort", "torque limit"
SHARP, LATE, FILTERED = "sampled", "sampled, late velocity", "sampled, filtered velocity"
"""Cases of `SwapRow`."""

LEVELS = {
    FRICTION: "friction over torque limit [-]",
    EFFORT: "friction over drive torque [-]",
    LIMIT: "limit over largest torque asked for [-]",
    SHARP: "control period [s]",
    LATE: "control period [s]",
    FILTERED: "control period [s]",
}
"""Case -> what its level is."""


@dataclass(frozen=True)
class SwapRow:
    """One joint with and without a swap at equal B + k kd, in one case."""

    robot: str
    """Whose joint."""
    case: str
    """One of `LEVELS`."""
    level: float
    """How much of it; see `LEVELS`."""
    swap: str
    """How much was moved, in words."""
    moved: float
    """Damping moved from k kd to B [N m s/rad]."""
    amplitude: float
    """Largest angle of the motion without the swap [rad]."""
    position_difference: float
    """Largest difference of the angle [rad]."""
    velocity_difference: float
    """Largest difference of the velocity [rad/s]."""
    torque_difference: float
    """Largest difference of the motor's torque [N m]."""
    growth: float | None
    """Factor by which the sampled loop without limit and friction grows a period, before the swap: unstable above 1."""
    growth_swapped: float | None
    """The same after it."""


@dataclass(frozen=True)
class NetRow:
    """A linear Actuator Net in a simulation with some viscous friction, against the joint that it was logged on."""

    robot: str
    """Whose joint."""
    friction_level: float
    """Dry friction of the logged joint over its torque limit [-]."""
    log: str
    """Which torque it learned: `motor_side` (B and friction not in it) or `output_side` (in it)."""
    simulated: str
    """B in the simulation: `own`, the logged joint's; `swapped`, half of k kd more; `dropped`, none."""
    damping: float
    """What the net learned per velocity [N m s/rad]."""
    total: float
    """That and the simulation's B [N m s/rad]."""
    true_total: float
    """B + k kd of the logged joint [N m s/rad]."""
    position_difference: float
    """Largest difference of the angle from the logged joint's [rad]."""


@dataclass(frozen=True)
class DrawRow:
    """Joints with drawn damping, in one situation."""

    robot: str
    """Whose joint."""
    situation: str
    """`free`, `torque limit` or `sampled`."""
    way: str
    """What was drawn."""
    damping_std: float
    """Standard deviation of B + k kd over the draws [N m s/rad]."""
    spread: float
    """Standard deviation of the angle over the draws, root mean square over time [rad]."""
    pair_difference: float | None
    """Largest difference of the angle between a draw and the one of B and kd with the same sum [rad];
    None where the sums differ."""


@dataclass(frozen=True)
class RobotRow:
    """A whole robot in the training's simulator with and without half of kd moved to B in every joint."""

    policy: str
    """Name of the bundle that drove it, or `in the air` for a hanging robot that swings its legs."""
    friction_level: float
    """Dry friction over torque limit in every joint [-]."""
    command: str
    """Commanded velocity; in the air the robot."""
    limits: str
    """The motors' torque limits: `own`, or `lifted`, a hundred times as high."""
    saturated_share: float
    """Share of joints and physics steps at the torque limit, without the swap, the first 2 s of a walk left out [-]."""
    speed: float | None
    """Mean speed along the command [m/s], None in the air."""
    speed_swapped: float | None
    """The same with the swap [m/s]."""
    free_robots: int
    """Robots that reached no torque limit within the first second, with and without the swap."""
    free_difference: float | None
    """Of these, the largest difference of a joint's angle in that second [rad]; None without any."""
    limited_robots: int
    """Robots that did reach one."""
    limited_difference: float | None
    """Of these, the same [rad]; None without any."""
    twin_difference: float
    """The same of all robots, to robots without a swap that start 1e-9 rad apart: what contacts make of rounding [rad].
    """
