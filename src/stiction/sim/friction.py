"""Dry friction in the batched simulator: each joint's bound, written from its state before each physics step.

The solver's friction holds a joint with any torque up to a bound, and brakes it with the bound where it slides
(`Fleet.friction` [N m]). The bound is the law's level times a factor of what the law reads
(`stiction.joints.friction.LAWS`). What depends on the motor's torque or on what a joint transmits acts one physics step
late, as torque and sensors do.

`load` counts what the joint really transmits, contacts included. The joint friction of PhysX up to 5.3 is a coefficient
too, but of the motion *without* contacts, drives and friction: on a walking robot it is nearly `effort`, see
tests/sim/test_physx_friction.py.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.joints.friction import Law, Signal
from stiction.sim.fleet import BASE_DOFS, Fleet


def load_size(load: np.ndarray) -> np.ndarray:
    """Return |F| + |T|, shape (N, joints), of `Fleet.joint_load`, shape (N, joints, 2, 3)."""
    return np.sqrt(np.square(load).sum(axis=-1)).sum(axis=-1)


SIGNALS: dict[Signal, Callable[[Fleet], np.ndarray]] = {
    "velocity": lambda fleet: fleet.joint_velocity,
    "load": lambda fleet: load_size(fleet.joint_load),
    "torque": lambda fleet: fleet.torque,
}
"""What a law may read, shape (N, joints)."""


class JointFriction:
    """Dry friction of a fleet's joints under one law, or under several whose bounds add up.

    `levels` are what a robot is given under each law, shape (N, joints): a torque [N m], or the coefficient. A robot
    that has just been reset has the bound of its standing pose.
    """

    def __init__(self, fleet: Fleet, *laws: Law) -> None:
        """Begin without friction.

        Raises `StictionError` where a law reads a load that the fleet does not measure, or two of them read sensors.
        """
        sensed = [number for number, law in enumerate(laws) if law.spec.sensed]
        if len(sensed) > 1:
            raise ConfigurationError(
                f"the friction laws {' and '.join(law.name for law in laws)} each read a sensor; give one of them"
            )
        for law in laws:
            if law.spec.loaded and not fleet.joint_load.size:
                raise ConfigurationError(
                    f"the friction law {law.name!r} needs a fleet with joint sensors; make it with joint_sensors"
                )
        self.fleet, self.laws = fleet, laws
        self.levels = [np.zeros_like(fleet.friction) for _ in laws]
        self._bounds = [np.zeros_like(fleet.friction) for _ in laws]
        self._sensed = sensed[0] if sensed else None
        self._restored: np.ndarray | None = None
        self._fresh = np.ones(fleet.num_envs, bool)
        fleet.friction[:] = 0.0
        if any(law.spec.reads for law in laws):
            fleet.before_step.append(self.act)
            fleet.after_reset.append(self.forget)

    def set_level(self, *levels: np.ndarray, ids: np.ndarray | slice = slice(None)) -> None:
        """Give the robots `ids` their level under each law, shape (len(ids), joints), and the bounds of now."""
        for level, values in zip(self.levels, levels, strict=True):
            level[ids] = values
        self.forget(ids)

    def forget(self, ids: np.ndarray | slice) -> None:
        """Give the robots `ids`, which were just reset, the bounds of their present state in place of their old ones.

        Whoever reads `Fleet.friction` before the next step would else see the friction of the robot before.
        """
        for law, level, bound in zip(self.laws, self.levels, self._bounds, strict=True):
            now = level[ids] * self.factor(law, ids)
            # Of a robot that blew up nothing is known before its reset.
            bound[ids] = np.where(np.isfinite(now), now, bound[ids])
        self._fresh[ids] = True
        self.fleet.friction[ids] = sum(bound[ids] for bound in self._bounds)

    def act(self, fleet: Fleet) -> None:
        """Write the bounds of the coming step.

        A robot that blew up has no finite state until its reset at the end of the control period; its bounds stay.
        """
        for number, (law, level, last) in enumerate(zip(self.laws, self.levels, self._bounds, strict=True)):
            # In the first step from a checkpoint the sensors have measured nothing; what they had is in the checkpoint.
            known = self._restored is not None and number == self._sensed
            bound = level * (self._restored if known else self.factor(law))
            if law.spec.smoothing:
                smoothing = np.where(self._fresh, 0.0, law.spec.smoothing)[:, None]
                bound = smoothing * last + (1.0 - smoothing) * bound
            np.copyto(last, bound, where=np.isfinite(bound))
        self._restored = None
        self._fresh[:] = False
        fleet.friction[:] = sum(self._bounds)

    def factor(self, law: Law, ids: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return what the level of one law is multiplied by now, shape (len(ids), joints), or one number."""
        return np.asarray(law.factor(**{name: SIGNALS[name](self.fleet)[ids] for name in law.spec.reads}))

    def state(self) -> dict[str, np.ndarray]:
        """Return a copy of what the next step depends on beside the simulation's state and `levels`.

        Of laws that read nothing there is none; sensors, which are not in the simulation's state, are in this one.
        """
        if not any(law.spec.reads for law in self.laws):
            return {}
        state = {"friction": self.fleet.friction.copy()}
        if self._sensed is not None:
            bound, measured = self._bounds[self._sensed], self.factor(self.laws[self._sensed])
            state |= {"bound": bound.copy(), "measured": measured.copy(), "fresh": self._fresh.copy()}
        return state

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Restore what `state` returned; the next step is then bit-identical."""
        self.forget(slice(None))
        if self._sensed is not None and state:
            self._bounds[self._sensed][:] = state["bound"]
            self._restored, self._fresh = state["measured"].copy(), state["fresh"].copy()
        # Older states are without it.
        self.fleet.friction[:] = state.get("friction", sum(self._bounds))


class FrictionMeter:
    """Measures the dry friction of the physics step about to be taken. Append it to `before_step`, after all others.

    The batch does not show the rows of its solver: they are computed once more, robot by robot, from the same state by
    the same code, which is exact and slow.
    """

    def __init__(self, fleet: Fleet) -> None:
        """Copy each robot's model as it is now; of it only dry friction may change later."""
        self._copies = [fleet.simulation.materialize(env) for env in range(fleet.num_envs)]
        self.torque = np.zeros((fleet.num_envs, fleet.spec.num_joints))
        """Torque of dry friction on each joint, against its motion [N m], shape (N, J)."""

    def __call__(self, fleet: Fleet) -> None:
        """Solve the coming step of every robot and keep the forces of its friction rows."""
        state = fleet.simulation.state()
        for env, (model, data) in enumerate(self._copies):
            for name, values in state.items():
                if name == "time":
                    data.time = float(np.ravel(values[env])[0])
                else:
                    field = getattr(data, name)
                    field[...] = values[env].reshape(field.shape)
            model.dof_frictionloss[BASE_DOFS:] = fleet.friction[env]
            mujoco.mj_forward(model, data)
            rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF
            self.torque[env] = 0.0
            self.torque[env, data.efc_id[rows] - BASE_DOFS] = data.efc_force[rows]
