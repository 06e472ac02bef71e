"""Draws of an mjlab task's events: their place in the compiled model, and the declared range."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import exp
from typing import Any

import numpy as np
from mjlab.envs.mdp import dr
from mjlab.managers.event_manager import _DERIVED_FIELDS, RecomputeLevel
from mjlab.managers.scene_entity_config import SceneEntityCfg

from stiction.core.draws import Draw, Range, check_draws
from stiction.exchange.mjlab.actuator import prepare_friction_law
from stiction.exchange.mjlab.friction import DrawFriction
from stiction.exchange.mjlab.motors import gains_of, motors_of, torque_limits_of

PLACES = {
    "dof": ("joint_v_adr", "joint"),
    "jnt": ("joint_ids", "joint"),
    "qpos0": ("joint_q_adr", "joint"),
    "body": ("body_ids", "body"),
    "geom": ("geom_ids", "geom"),
    "site": ("site_ids", "site"),
    "actuator": ("ctrl_ids", "actuator"),
    "tendon": ("tendon_ids", "tendon"),
    "cam": ("cam_ids", "camera"),
    "light": ("light_ids", "light"),
    "mat": ("mat_ids", "material"),
    "pair": ("pair_ids", "pair"),
}
"""First word of a model field -> place of an entity's parts in it, and mjlab's name for them."""

LIBRARY = "mjlab.envs.mdp.dr"
"""Package of mjlab's own draws, whose parameters are understood."""


@dataclass(frozen=True)
class Drawn:
    """Value that an event draws."""

    event: str
    quantity: str
    """Field of the model, and the reference that it is compared with."""
    declared: Range | None
    read: Callable[[], Any]
    """Function that returns the present value, of shape (num_envs, entries)."""
    entries: tuple[str, ...]
    """Names of joints, bodies, geometries; empty where they have none."""
    constant: bool = False
    """True if the event writes the same values whenever it is called."""


@dataclass(frozen=True)
class DrawnRow:
    """Observed range of a value that an event draws, with the verdict."""

    event: str
    quantity: str
    declared: Range | None
    seen: Range | None
    verdict: str
    """Verdict as of `Draw`, with the names of entries without effect; `constant, no range declared` is no failure."""
    ok: bool


def audit_draws(env: Any, resets: int = 4) -> list[DrawnRow]:
    """Reset an mjlab environment several times, a step after each reset, and judge what its events draw.

    A step, because delays are drawn in it, and because an actuator may write over what an event has drawn.
    """
    drawn = [*drawn_by_events(env), *delays(env)]
    still = env.scene.env_origins.new_zeros(env.num_envs, env.action_manager.total_action_dim)

    def reset() -> None:
        env.reset()
        env.step(still)

    def read() -> dict[str, Any]:
        return {str(number): value.read().double().cpu().numpy() for number, value in enumerate(drawn)}

    judged = check_draws(reset, read, {str(n): value.declared for n, value in enumerate(drawn)}, resets=resets)
    return [_row(value, draw) for value, draw in zip(drawn, judged, strict=True)]


def _row(drawn: Drawn, draw: Draw) -> DrawnRow:
    """Return the row of a value, its verdict with the names of up to three entries that never change."""
    verdict, ok = draw.verdict, draw.ok
    if not ok and drawn.constant:
        verdict, ok = "constant, no range declared", True
    elif not ok and draw.still and len(drawn.entries) > 1:
        names = [drawn.entries[number % len(drawn.entries)] for number in draw.still]
        verdict += f": {', '.join([*dict.fromkeys(names)][:3])}{' ...' if len({*names}) > 3 else ''}"
    return DrawnRow(drawn.event, drawn.quantity, draw.declared, draw.seen, verdict, ok)


def drawn_by_events(env: Any) -> list[Drawn]:
    """Return the values of its model that the events of an environment draw, without pushes and start poses."""
    manager = env.event_manager
    return [
        replace(drawn, event=name)
        for names in manager.active_terms.values()
        for name in names
        for drawn in _drawn_by(env, manager.get_term_cfg(name))
    ]


def _drawn_by(env: Any, term: Any) -> Iterator[Drawn]:
    """Yield the values that one event draws."""
    func, params = term.func, term.params
    asset_cfg = params.get("asset_cfg", SceneEntityCfg("robot"))
    known = getattr(func, "__module__", "").startswith(LIBRARY)
    if isinstance(func, DrawFriction):
        yield Drawn(
            "",
            "dof_frictionloss / torque limit",
            tuple(np.multiply(params["shares"], params.get("moving", (1.0, 1.0))).tolist()),
            lambda: env.sim.model.dof_frictionloss[:, func.dofs] / func.limits,
            tuple(motors_of(env, env.scene[params["entity"]])),
        )
    elif func is prepare_friction_law:
        return  # it prepares what actuators write at each physics step
    elif func is dr.encoder_bias:
        asset, joints = env.scene[asset_cfg.name], asset_cfg.joint_ids
        names = tuple(np.array(asset.joint_names)[joints])
        yield Drawn("", "encoder_bias", params["bias_range"], lambda: asset.data.encoder_bias[:, joints], names)
    elif func is dr.pd_gains:
        for number, name in enumerate(("kp", "kd")):
            yield from _of_actuators(env, asset_cfg, params, name, f"{name}_range", number, gains_of)
    elif func is dr.effort_limits:
        yield from _of_actuators(env, asset_cfg, params, "effort limit", "effort_limit_range", 0, torque_limits_of)
    elif func is dr.pseudo_inertia and any(params.get("alpha_range", ())):
        # The matrix that multiplies the pseudo-inertia from both sides has exp(alpha) where the mass is.
        low, high = (exp(2 * end) for end in params["alpha_range"])
        yield _of_field(env, asset_cfg, "body_mass", "scale", None, (low, high))
    elif known and "ranges" in params:
        yield from _of_ranges(env, asset_cfg, func, params)
    else:
        yield from _written(env, term)


def _of_ranges(env: Any, asset_cfg: Any, func: Any, params: dict[str, Any]) -> Iterator[Drawn]:
    """Yield the values of a draw of mjlab's own: a range, or one for each axis or pattern of names."""
    field, ranges = func.model_fields[0], params["ranges"]
    defaults = {name: parameter.default for name, parameter in inspect.signature(func).parameters.items()}
    operation = _word(params.get("operation", defaults.get("operation", "abs")))
    axes = params.get("axes") or ([0] if field in ("geom_friction", "pair_friction") else None)
    # Of a normal distribution the two numbers are mean and deviation.
    bounded = _word(params.get("distribution", "uniform")) in ("uniform", "log_uniform")
    parts: list[tuple[Any, ...]] = [(asset_cfg, axes, ranges, "")]
    if isinstance(ranges, dict) and all(isinstance(key, int) for key in ranges):
        parts = [(asset_cfg, [axis], of_axis, "") for axis, of_axis in ranges.items() if axes is None or axis in axes]
    elif isinstance(ranges, dict):
        parts = [(_matching(env, asset_cfg, field, name), axes, of_it, f" of {name}") for name, of_it in ranges.items()]
    for of_part, of_axes, of_range, whose in parts:
        drawn = _of_field(env, of_part, field, operation, of_axes, tuple(of_range) if bounded else None)
        yield replace(drawn, quantity=drawn.quantity + whose)


def _word(value: Any) -> str:
    """Return the name of an operation or a distribution, which mjlab takes as a text or an object of its own."""
    return str(getattr(value, "name", value))


def _matching(env: Any, asset_cfg: Any, field: str, pattern: str) -> Any:
    """Return the configuration of the parts of an entity whose names match."""
    kind = PLACES[field.split("_")[0]][1]
    names = getattr(env.scene[asset_cfg.name], f"{kind}_names")
    ids = [number for number, name in enumerate(names) if re.fullmatch(pattern, name)]
    return SceneEntityCfg(asset_cfg.name, **{f"{kind}_ids": ids})


def _of_field(env: Any, asset_cfg: Any, field: str, operation: str, axes: Any, declared: Range | None) -> Drawn:
    """Return a value of a model field, as the operation compares it with its default."""
    where, kind = PLACES[field.split("_")[0]]
    asset, chosen = env.scene[asset_cfg.name], getattr(asset_cfg, f"{kind}_ids")
    ids = getattr(asset.indexing, where)[chosen]
    names = np.array(getattr(asset, f"{kind}_names"), dtype=object)[chosen]
    if field == "body_mass" and operation == "scale":
        # A frame has no mass, which is no fault of a draw of all bodies.
        massive = env.sim.mj_model.body_mass[ids.cpu().numpy()] > 0
        ids, names = ids[massive.nonzero()[0]], names[massive]
    names = np.repeat(names, len(axes or [0]))

    def part(values: Any) -> Any:
        values = values[:, ids]
        return values[..., axes] if axes is not None and values.ndim > 2 else values

    def read() -> Any:
        default = env.sim.get_default_field(field)
        return compared(
            part(getattr(env.sim.model, field)),
            part(default if field in env.sim.per_world_default_fields else default.unsqueeze(0)),
            operation,
        )

    of_axes = f"[{', '.join(str(axis) for axis in axes)}]" if axes is not None else ""
    return Drawn("", f"{field}{of_axes}{COMPARED.get(operation, '')}", declared, read, tuple(names))


COMPARED = {"scale": " / default", "add": " - default"}
"""Operation of a draw -> how its value is compared with the default."""


def compared(values: Any, default: Any, operation: str) -> Any:
    """Return a value as the range of a draw defines it; not-a-number for a multiple of 0."""
    if operation == "scale":
        return (values / default).where(default.expand_as(values) != 0, float("nan"))
    return values - default if operation == "add" else values


def _of_actuators(
    env: Any, asset_cfg: Any, params: dict[str, Any], name: str, key: str, number: int, values_of: Callable[..., Any]
) -> Iterator[Drawn]:
    """Yield a gain or limit of each actuator that an event draws; number: its index in the result of `values_of`."""
    asset, operation = env.scene[asset_cfg.name], _word(params.get("operation", "scale"))
    chosen = np.array(asset.actuators, dtype=object)[asset_cfg.actuator_ids]
    for actuator in np.atleast_1d(chosen):

        def read(actuator: Any = actuator) -> Any:
            return compared(values_of(env, actuator)[number], values_of(env, actuator, default=True)[number], operation)

        quantity = f"{name}{COMPARED.get(operation, '')}"
        yield Drawn("", quantity, tuple(params[key]), read, tuple(actuator.target_names))


def _written(env: Any, term: Any) -> Iterator[Drawn]:
    """Yield the fields of the model that any other event writes when it is called twice, and those that it names.

    An event that names no field writes one number for all worlds.
    """
    level = getattr(term.func, "recompute", RecomputeLevel.none)
    named = [field for field in getattr(term.func, "model_fields", ()) if field not in _DERIVED_FIELDS[level]]
    fields = {name: value for name in vars(env.sim.wp_model) if (value := _per_world(env, name)) is not None}
    before = {name: value.clone() for name, value in fields.items()}
    robots = None if term.mode in ("startup", "step") else env.scene.env_origins.new_tensor(range(env.num_envs)).long()

    def called(begin: dict[str, Any]) -> dict[str, Any]:
        for name, value in begin.items():
            _restore(fields[name], value)
        term.func(env, robots, **term.params)
        after = {name: value.clone() for name, value in fields.items()}
        for name, value in before.items():
            _restore(fields[name], value)
        return after

    first, second = called(before), called(before)
    # A present value may be a constant that was written before: from other values it is written again.
    other = {name: before[name] + 1.0 for name in named if name in fields and (first[name] == before[name]).all()}
    again = called(before | other) if other else {}
    for name in fields:
        changed = _parts(first[name] != before[name]) | _parts(second[name] != before[name])
        constant = bool((first[name] == second[name]).all())
        if name in other:
            changed = _parts(again[name] != other[name])
            constant = bool(changed.any())
        if not (changed.any() or name in named):
            continue
        # All of it where the event names a field and leaves it as it is.
        ids = changed.nonzero().ravel() if changed.any() else slice(None)
        read = lambda name=name, ids=ids: getattr(env.sim.model, name)[:, ids].flatten(1)  # noqa: E731
        yield Drawn("", name, None, read, (), constant)


def _parts(changed: Any) -> Any:
    """Return the parts of a field that changed, of shape (parts,), from booleans of shape (num_envs, parts, ...)."""
    return changed.flatten(2).any(dim=-1).any(dim=0) if changed.ndim > 2 else changed.any(dim=0)


def _per_world(env: Any, name: str) -> Any:
    """Return a field of the model as a tensor of shape (num_envs, parts, ...), None for any other array."""
    array = getattr(env.sim.wp_model, name)
    # mjlab cannot show an array that is empty, such as that of tendons where there are none.
    if name.split("_")[0] not in PLACES or not getattr(array, "size", 0) or not hasattr(env.sim.mj_model, name):
        return None
    value = getattr(env.sim.model, name)[:]
    return value if value.ndim > 1 and value.shape[0] == env.num_envs and value.is_floating_point() else None


def _restore(value: Any, before: Any) -> None:
    """Write a field as it was; one that all worlds share has one place in memory."""
    if value.stride(0) == 0:
        value, before = value[0], before[0]
    value.copy_(before)


def delays(env: Any) -> list[Drawn]:
    """Return the delays of commands that actuators draw [physics steps]."""
    drawn = []
    for entity in env.scene.entities.values():
        for actuator in getattr(entity, "actuators", ()):
            least, most = actuator.cfg.delay_min_lag, actuator.cfg.delay_max_lag
            if least != most:
                buffer, name = actuator._delay_buffer, f"delay of {actuator.target_names[0]} ... [physics steps]"
                read = lambda buffer=buffer: buffer.current_lags.unsqueeze(1)  # noqa: E731
                drawn.append(Drawn("(actuator)", name, (float(least), float(most)), read, ()))
    return drawn
