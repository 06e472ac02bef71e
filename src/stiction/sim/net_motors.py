"""An Actuator Net in place of the PD law, for a whole fleet, at every physics step. NumPy: neither torch nor a GPU.

* Gains and delays are the net's; the simulator's own delay is off. A motor strength multiplies what the net gives.
* Damping is explicit: the net's torque is held over a step, while MuJoCo takes kd of a PD law implicitly.
* Friction: a net of motor-side torque does not contain the joint's friction, the simulation keeps its own. A net of
  output-side torque contains dry and viscous friction, the simulation's are zero. Rotor inertia is in neither.
"""

from __future__ import annotations

import numpy as np

from stiction.joints.net import ActuatorMemory, ActuatorNet
from stiction.sim.fleet import Fleet


class NetMotors:
    """Motors of a fleet whose torque an Actuator Net gives, from targets that are held over the control period."""

    def __init__(self, fleet: Fleet, net: ActuatorNet) -> None:
        """Take over the fleet's actuators, and its joints' friction where the net contains it.

        Raises:
            FileError: the net is for other joints, other torque limits or another physics step.

        """
        net.check_use(fleet.spec.name, fleet.spec.joint_names, fleet.torque_limit, fleet.timestep)
        self.net, self.memory = net, ActuatorMemory(net, fleet.num_envs)
        self.strength = np.ones((fleet.num_envs, fleet.spec.num_joints))
        """Torque delivered over torque that the net gives, shape (N, J); the torque limit stays."""
        self._command = fleet.drive_by_torque()
        if self.holds_friction:
            fleet.friction[:] = 0.0
            fleet.damping[:] = 0.0
        fleet.before_step.append(self._act)
        fleet.after_reset.append(self.memory.forget)

    @property
    def holds_friction(self) -> bool:
        """Whether the joints' dry and viscous friction are in the net: the simulation's own must then be zero."""
        return self.net.torque_source == "output_side"

    def _act(self, fleet: Fleet) -> None:
        """Set the torques of the coming physics step; the simulator clips them to the limits."""
        # A robot that blew up within the control period is reset at its end; until then its numbers are what they are.
        with np.errstate(invalid="ignore", over="ignore"):
            torque = self.memory.torque(fleet.targets, fleet.joint_position, fleet.joint_velocity)
            np.multiply(torque, self.strength, out=self._command)

    def state(self) -> dict[str, np.ndarray]:
        """Return what the next torque depends on beside the simulation and `strength`, copies, for a checkpoint."""
        return {"past": self.memory.past.copy(), "fresh": self.memory.fresh.copy()}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Restore what `state` returned."""
        self.memory.past[...] = state["past"]
        self.memory.fresh[...] = state["fresh"]
