"""Laws of dry friction in the batched simulator: each joint's bound, written from its state before each physics step.

The solver's friction holds a joint with any torque up to a bound, and brakes it with the bound where it slides
(`Fleet.friction` [N m]). A law says what the bound is:

    coulomb    f_c
    stribeck   f_c + (f_s - f_c) exp(-(q'/v_s)²),  f_s = static_ratio f_c
    effort     c |τ|, of the motor's torque
    load       c (|F| + |T|), of the force and the torque that the joint transmits, T about the centre of mass of the
               link behind the joint

All of it NumPy over all robots at once. `effort` and `load` act one physics step late, as `torque` and sensors do.

What PhysX does. Up to 5.3 a joint's friction is a coefficient; `load` is its law, as measured in PhysX 5.3.1 (sapien
3.0.3) on a joint that is fixed to the world, sliding under a drive (numbers in the test of this module):

* the bound is c (|F| + |T|) to all digits, forces and torques added up as numbers; |T| is about the child link's centre
  of mass (not the joint), axial component included;
* it does not depend on the time step, but a sliding joint feels it times (P + V) / P for P position and V velocity
  iterations of the solver: 1.1 with sapien's 10 and 1. That is a fault of iteration, and not in our law;
* F and T are those of the motion *without* contacts, drives and friction. So a torque put in as a joint force counts,
  the same torque of a drive does not, and **what the ground bears does not count at all**: a robot on its feet
  "falls freely" in that motion, and transmits nothing. A body of 50 N on a joint on a free foot on the ground: friction
  0.000 N m at c = 0.05 under a drive, 0.055 and 0.220 N m under joint forces of 1 and 4 N m (1.1 c |τ|); with the foot
  fixed to the world 2.75 N m. In that engine, on a walking robot, the coefficient is nearly the law `effort`.

`load` here counts what the joint really transmits, contacts included: what a worn or preloaded bearing does.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from stiction.formats.errors import StictionError
from stiction.formats.friction import Law
from stiction.sim.fleet import Fleet

KEPT = 0.5
"""Share of the old bound that `load` keeps at each physics step; see `LoadFriction`."""


def stribeck_bound(
    coulomb: np.ndarray, ratio: float | np.ndarray, velocity: float | np.ndarray, speed: np.ndarray
) -> np.ndarray:
    """Return f_c + (f_s - f_c) exp(-(q'/v_s)²) [N m], f_s = ratio f_c; `speed`: q' [rad/s], the shape of `coulomb`."""
    return coulomb * (1.0 + (ratio - 1.0) * np.exp(-np.square(speed / velocity)))


def load_size(load: np.ndarray) -> np.ndarray:
    """Return |F| + |T|, shape (N, joints), of `Fleet.joint_load`, shape (N, joints, 2, 3)."""
    return np.sqrt(np.square(load).sum(axis=-1)).sum(axis=-1)


class JointFriction:
    """Dry friction of a fleet's joints: Coulomb's law, and what the laws share.

    `level` is what a robot is given, shape (N, joints): f_c [N m], or the coefficient c.
    """

    def __init__(self, fleet: Fleet) -> None:
        """Begin without friction."""
        self.fleet = fleet
        self.level = np.zeros_like(fleet.friction)
        fleet.friction[:] = 0.0

    def set_level(self, level: np.ndarray, ids: np.ndarray | slice = slice(None)) -> None:
        """Give the robots `ids` their level, shape (len(ids), joints)."""
        self.level[ids] = level
        self.fleet.friction[ids] = level

    def state(self) -> dict[str, np.ndarray]:
        """Return a copy of what the next step depends on beside the simulation's state and `level`."""
        return {}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Restore what `state` returned."""


class StribeckFriction(JointFriction):
    """More friction at rest than in motion, of the velocity at the start of each physics step."""

    def __init__(self, fleet: Fleet, static_ratio: float, stribeck_velocity: float) -> None:
        """`static_ratio`: f_s / f_c [1]; `stribeck_velocity`: v_s [rad/s]."""
        super().__init__(fleet)
        self.ratio, self.velocity = static_ratio, stribeck_velocity
        fleet.before_step.append(self.act)

    def act(self, fleet: Fleet) -> None:
        """Write the bounds of the coming step."""
        bound = stribeck_bound(self.level, self.ratio, self.velocity, fleet.joint_velocity)
        np.copyto(fleet.friction, bound, where=np.isfinite(bound))


class MeasuredFriction(JointFriction, ABC):
    """c times something that is measured at the joint, as it was in the last physics step.

    A robot that has just been reset has the bound of its standing pose.
    """

    kept = 0.0
    """Share of the old bound that is kept at each physics step."""

    def __init__(self, fleet: Fleet) -> None:
        """Begin without a past."""
        super().__init__(fleet)
        self._fresh = np.ones(fleet.num_envs, bool)
        self._stored: np.ndarray | None = None
        fleet.before_step.append(self.act)
        fleet.after_reset.append(self.forget)

    @abstractmethod
    def measure(self) -> np.ndarray:
        """Return what c multiplies, shape (N, joints)."""

    def set_level(self, level: np.ndarray, ids: np.ndarray | slice = slice(None)) -> None:
        """Give the robots `ids` their coefficients, shape (len(ids), joints), and forget their past."""
        self.level[ids] = level
        self._fresh[ids] = True

    def forget(self, ids: np.ndarray) -> None:
        """Let the robots `ids`, just reset, keep nothing of their old bounds."""
        self._fresh[ids] = True

    def act(self, fleet: Fleet) -> None:
        """Write the bounds of the coming step.

        A robot that blew up has no finite load until its reset at the end of the control period; its bounds stay.
        """
        measured = self.measure() if self._stored is None else self._stored
        self._stored = None
        bound = self.level * measured
        if self.kept:
            kept = np.where(self._fresh, 0.0, self.kept)[:, None]
            bound = kept * fleet.friction + (1.0 - kept) * bound
        np.copyto(fleet.friction, bound, where=np.isfinite(bound))
        self._fresh[:] = False

    def state(self) -> dict[str, np.ndarray]:
        """Return the last bounds, the measurement (a checkpoint of the simulation has no sensors), and who is fresh."""
        return {"bound": self.fleet.friction.copy(), "measured": self.measure().copy(), "fresh": self._fresh.copy()}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Restore what `state` returned; the next step is then bit-identical."""
        self.fleet.friction[:] = state["bound"]
        self._stored, self._fresh = state["measured"].copy(), state["fresh"].copy()


class EffortFriction(MeasuredFriction):
    """c |τ| of the motor's torque: what the documentation of one simulator calls friction of the effort.

    A motor always overcomes it (c < 1); what it resists is a load that drives the motor back.
    """

    def measure(self) -> np.ndarray:
        """Return |τ| [N m]."""
        return np.abs(self.fleet.torque)


class LoadFriction(MeasuredFriction):
    """c (|F| + |T|) of what the joint transmits, half of the old bound kept.

    Friction at a joint changes the forces that it transmits, and those, a step later, the friction: a loop that
    chatters at a large c, and contacts make the forces jump. Walking Saturn Lite at c = 0.442 (0.1, 0.02), 5 ms: with
    nothing kept the change from step to step is 34 % (55, 30 %) of the mean bound and reverses its sign in 58 % (48,
    42 %) of the steps, a random walk does in 50 %; with half kept 15 % (31, 17 %) and 33 % (32, 30 %). The mean bound
    changes by 2 % (3, 0 %). Three quarters kept calm it further, but delay it by 15 ms and help the policy: 0.24 m/s at
    c = 0.1 in place of 0.20 (nothing kept) and 0.21 (half).
    """

    kept = KEPT

    def __init__(self, fleet: Fleet) -> None:
        """Raise `StictionError` where the fleet measures no load."""
        if not fleet.joint_load.size:
            raise StictionError("the friction law 'load' needs a fleet with joint sensors; make it with joint_sensors")
        super().__init__(fleet)

    def measure(self) -> np.ndarray:
        """Return |F| + |T|."""
        return load_size(self.fleet.joint_load)


def needs_sensors(law: Law) -> bool:
    """Say whether a fleet must measure what its joints transmit."""
    return law.name == "load"


def joint_friction(fleet: Fleet, law: Law) -> JointFriction:
    """Give a fleet's joints a law of friction, at level zero; return what sets the level.

    Raises `StictionError` for `load` on a fleet without joint sensors.
    """
    if law.name == "stribeck":
        return StribeckFriction(fleet, law.static_ratio, law.stribeck_velocity)
    kinds = {"coulomb": JointFriction, "effort": EffortFriction, "load": LoadFriction}
    return kinds[law.name](fleet)
