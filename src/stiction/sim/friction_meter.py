"""What dry friction took in each joint of a fleet: the constraint solver's own answer, step by step.

The solver's rows live in an arena that a batch does not show. They are computed once more, robot by robot, from the
same state by the same code: the result is the same to the last bit, at some 0.1 ms a robot and step, so this is for
logs and tests, not for training.
"""

from __future__ import annotations

import mujoco
import numpy as np

from stiction.sim.fleet import BASE_DOFS, Fleet


class FrictionMeter:
    """Measures the dry friction of the physics step about to be taken. Append it to `before_step`, after all others."""

    def __init__(self, fleet: Fleet) -> None:
        """Copy each robot's model as it is now; dry friction may change later, the rest may not."""
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
