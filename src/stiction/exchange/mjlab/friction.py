"""Dry friction drawn in mjlab as a `training.json` proposes it, and its observation."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

from mjlab.managers.event_manager import EventTermCfg, requires_model_fields

from stiction.core.errors import ConfigurationError
from stiction.exchange.mjlab.actuator import driven_by_law
from stiction.exchange.mjlab.motors import limits_of, motors_of
from stiction.exchange.mjlab.rows import stiffen_rows, warn_of_budget
from stiction.exchange.physics import Which
from stiction.exchange.randomization import recipe_of
from stiction.files.joints import read_training


def friction_events(training: str | Path, entity: str = "robot", *, friction: Which = "moving") -> dict[str, Any]:
    """Return the event that draws dry friction at each reset as a `training.json` proposes, for `cfg.events`.

    Where the proposal is of one number a robot, all joints of a robot have the same share of their torque limits,
    whatever those are; a term of mjlab for each limit would draw one number each.

    Args:
        training: the `training.json` of `stiction identify`.
        entity: name of the robot among the scene's entities.
        friction: dry friction in motion (`moving`), for which the proposed ratio to that at rest is drawn too, or at
            rest (`static`): MuJoCo has one number. A `UserWarning` names the part of the proposal that it cannot hold.

    Raises `StictionError` for a proposal without friction to draw.

    """
    path = Path(training)
    recipe = recipe_of(read_training(path), {entity: 1.0}, friction)
    moving = recipe.moving if friction == "moving" else (1.0, 1.0)
    if recipe.moving != (1.0, 1.0):
        drawn = "that in motion" if friction == "moving" else "that at rest"
        warnings.warn(
            f"{path.name} has more friction at rest than in motion, and MuJoCo one number: {drawn} is drawn, without "
            "the fall between them",
            stacklevel=2,
        )
    return draw_event((recipe.ranges[0].low, recipe.ranges[0].high), recipe.together, entity, moving)


def draw_event(
    shares: tuple[float, float],
    together: bool = True,
    entity: str = "robot",
    moving: tuple[float, float] = (1.0, 1.0),
) -> dict[str, Any]:
    """Return the event that draws dry friction at each reset, for `cfg.events`.

    shares: lowest and highest over the torque limit [1]; together: True if all joints of a robot get one share;
    moving: lowest and highest factor of the share [1], drawn too: friction in motion over that at rest.
    """
    params = {"shares": shares, "together": together, "entity": entity, "moving": moving}
    return {"joint_friction": EventTermCfg(func=DrawFriction, mode="reset", params=params)}


@requires_model_fields("dof_frictionloss", "dof_solref", "dof_solimp")
class DrawFriction:
    """Event: dry friction of every driven joint as a drawn share of its torque limit.

    The rows of friction become as stiff as the timestep allows: with MuJoCo's own settings a joint creeps below them.
    Raises `ConfigurationError` for a robot with an `IdentifiedActuator`, which would write over what is drawn.
    """

    def __init__(self, cfg: Any, env: Any) -> None:
        if by_law := driven_by_law(env.scene[cfg.params["entity"]]):
            raise ConfigurationError(
                f"friction_events: got joint {by_law[0]!r} of an IdentifiedActuator, which writes its friction at each "
                "physics step; leave one of the two out"
            )
        warn_of_budget(env)
        self.dofs, self.limits = _driven(env, cfg.params["entity"])

    def __call__(
        self,
        env: Any,
        env_ids: Any,
        shares: tuple[float, float],
        together: bool,
        entity: str,
        moving: tuple[float, float] = (1.0, 1.0),
    ) -> None:
        """Draw for the robots that are reset; env_ids: their numbers, all for None; the others as in `draw_event`."""
        rows = slice(None) if env_ids is None else env_ids[:, None]
        robots = env.num_envs if env_ids is None else len(env_ids)
        share = self.limits.new_empty(robots, 1 if together else len(self.limits)).uniform_(*shares)
        share = share * share.new_empty(share.shape).uniform_(*moving)
        env.sim.model.dof_frictionloss[rows, self.dofs] = share * self.limits
        stiffen_rows(env, rows, self.dofs)


class friction_told:  # as mjlab calls its terms, which are classes where they keep something
    """Observation: dry friction of every driven joint over its torque limit [1], shape (num_envs, joints).

    It is for critics and teachers, and for policies that get the identified friction on the robot.
    """

    def __init__(self, cfg: Any, env: Any) -> None:
        self.dofs, self.limits = _driven(env, cfg.params.get("entity", "robot"))

    def __call__(self, env: Any, entity: str = "robot") -> Any:
        """Return the friction that the robots have now; entity: name of the robot among the scene's entities."""
        return env.sim.model.dof_frictionloss[:, self.dofs] / self.limits


def _driven(env: Any, entity: str) -> tuple[Any, Any]:
    """Return the places of a robot's driven joints among the model's degrees of freedom, and torque limits [N m].

    Both are tensors of shape (joints,). Raises `ConfigurationError` for a joint without a torque limit.
    """
    asset = env.scene[entity]
    motors = motors_of(env, asset)
    dofs = asset.indexing.joint_v_adr[[motor.joint for motor in motors.values()]]
    # Of the device and the type of the model's numbers.
    return dofs, env.sim.model.dof_frictionloss[0].new_tensor(limits_of(motors))
