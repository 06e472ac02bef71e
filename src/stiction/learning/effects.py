"""Which settings of a training do nothing beside the others, and their refusal. No torch, no mujoco.

Two runs that differ in such a setting would be compared, and are the same run. A setting is refused where somebody has
changed it: what a preset brings along may be idle. Not in `__post_init__` of the configuration, for older runs may have
some.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from operator import attrgetter
from typing import Any, get_args

from stiction.core.errors import ConfigurationError
from stiction.core.flags import assignment, text_of
from stiction.joints.friction import find_law, has_coefficient
from stiction.learning.config import TrainCfg
from stiction.learning.presets import PresetName, preset

Idle = Iterator[tuple[str, str]]
"""Places of fields, or of whole groups of them, from `TrainCfg` on, and why they do nothing: what follows `has no
effect` in a sentence."""

OF_DISTILLATION = ("noise", "epochs", "mini_batches", "adaptation_weight", "estimator_weight")
"""Fields of `StudentCfg` that PPO on the student has no use for: it has the settings of the first phase."""

OF_MULTIPLIERS = ("per", "spread", "pretraining", "steps")
"""Fields of `FrictionCfg` about how multipliers above 0 are drawn. Level and law, with its numbers, are not among them:
a policy that is trained without friction is evaluated with them."""


OF_METHOD = "method_settings"
"""Field of `TrainCfg` whose fields are named after the method on command lines."""


def check_effects(cfg: TrainCfg, base: TrainCfg | None = None) -> None:
    """Refuse settings that were changed and have no effect.

    `base`: the configuration before anybody changed it; by default the presets' own values count as unchanged. Raises
    `ConfigurationError` naming the first one, and why.
    """
    _check_known_friction(cfg)
    unchanged = _presets(cfg) if base is None else (base,)
    for place, why in idle(cfg):
        for name in _leaves(cfg, place):
            value = attrgetter(name)(cfg)
            # The presets set none of a method's settings.
            bases = (replace(cfg, method_settings=None),) if name.startswith(f"{OF_METHOD}.") else unchanged
            if all(value != attrgetter(name)(one) for one in bases):
                raise ConfigurationError(f"{_typed(cfg, name, value)} has no effect{why}; leave it out")


def idle(cfg: TrainCfg) -> Idle:
    """Yield everything in a configuration that does nothing at all."""
    yield from cfg.method.idle(cfg)
    yield from _phases(cfg)
    yield from _ground(cfg)
    yield from _friction(cfg)
    yield from _task(cfg)
    yield from _run(cfg)


def _presets(cfg: TrainCfg) -> tuple[TrainCfg, ...]:
    """Return the defaults, and every preset as it is for the method, device and engine of a configuration."""
    method = cfg.task.friction.method
    return TrainCfg(), *(preset(name, cfg.device, method, cfg.engine) for name in get_args(PresetName))


def _leaves(cfg: TrainCfg, place: str) -> Iterator[str]:
    """Yield the places of all fields at and under a place."""
    value: Any = attrgetter(place)(cfg)
    if not is_dataclass(value):
        yield place
        return
    for field in fields(value):
        yield from _leaves(cfg, f"{place}.{field.name}")


def _but(cfg: TrainCfg, group: str, *kept: str) -> Iterator[str]:
    """Yield the places of the fields of a group, but for some."""
    yield from (f"{group}.{field.name}" for field in fields(attrgetter(group)(cfg)) if field.name not in kept)


def _typed(cfg: TrainCfg, name: str, value: Any) -> str:
    """Return a setting with its value as it is typed."""
    group, _, own = name.partition(".")
    return method_setting(cfg.method.name, own, value) if group == OF_METHOD else assignment(TrainCfg, name, value)


def method_setting(method: str, name: str, value: Any) -> str:
    """Return a setting of a method with its value as it is typed."""
    return f"--set {method}.{name}={text_of(value, setting=True)}"


def _check_known_friction(cfg: TrainCfg) -> None:
    """Refuse to tell a policy what a coefficient has not."""
    law = cfg.task.friction.law
    if cfg.task.known_friction and has_coefficient(law):
        raise ConfigurationError(
            f"--task.known-friction tells a policy the friction of its joints over their torque limits, and under "
            f"--friction-law {law} there is none: its level is a coefficient; use another law, or leave it out"
        )


def _phases(cfg: TrainCfg) -> Idle:
    """Yield what belongs to another phase, or another way to learn in it."""
    teacher, student = cfg.teacher, cfg.student
    if not student.iterations:
        for name in _but(cfg, "student", "iterations"):
            yield name, " with --student.iterations 0: there is no second phase"
    elif student.algorithm == "ppo":
        for name in OF_DISTILLATION:
            why = " with --student.algorithm ppo: it is of distillation, and PPO has the settings of the first phase"
            yield f"student.{name}", why
    if teacher.latent != "groups":
        yield "teacher.student_share", f" with --teacher.latent {teacher.latent}, only with groups"
    if teacher.latent != "alternate":
        yield "teacher.alternate", f" with --teacher.latent {teacher.latent}, only with alternate"
    if teacher.latent == "history":
        yield "network.privileged", " with --teacher.latent history: nobody walks on the privileged encoder's z"
    if teacher.quiet and teacher.quiet_from == teacher.iterations:
        why = f": of --teacher.iterations {teacher.iterations} at most a quarter is quiet, and that is none"
        yield "teacher.quiet", why


def _ground(cfg: TrainCfg) -> Idle:
    """Yield what belongs to another ground, or to another way to simulate it."""
    if cfg.task.terrain.kind == "flat":
        for name in (*_but(cfg, "task.terrain", "kind"), "network.terrain", "network.terrain_latent"):
            yield name, " on flat ground; --terrain has others"
    physics = cfg.task.physics
    if cfg.engine != "mujoco":
        for name in _but(cfg, "task.physics", "friction"):
            yield name, f" with --engine {cfg.engine}, which has a solver of its own"
    name, other = ("impedance", "rows") if physics.plastic else ("stiffness", "plastic")
    yield f"task.physics.{name}", f" with --physics {physics.friction}, only with {other}"
    if not cfg.task.friction.has_friction:
        for name in ("impedance", "stiffness"):
            yield f"task.physics.{name}", ": it is of joint friction, and the training has none"


def _friction(cfg: TrainCfg) -> Idle:
    """Yield what belongs to friction that is not drawn."""
    friction, place = cfg.task.friction, "task.friction."
    # Friction that is asked for and cannot be there is refused when the run begins, unless there is some of the load.
    if friction.level == 0.0 and friction.draws_load:
        for name in ("range", "mixture", *OF_MULTIPLIERS):
            yield place + name, ": at --friction-level 0 all multiples of it are 0, and friction is that of the load"
    elif friction.last.range[1] == 0.0:
        unless = " unless --task.friction.range or --task.friction.mixture asks for it"
        why = f": --method {friction.method} has no friction in training{'' if friction.method == 'none' else unless}"
        yield from ((place + name, why) for name in OF_MULTIPLIERS)
    for name in ("pretraining", "steps"):
        if name not in cfg.method.schedule_options:
            yield place + name, f" with --method {friction.method}: it is of other methods' schedules"
    for name in ("static_ratio", "stribeck_velocity"):
        if name not in find_law(friction.law).numbers:
            yield place + name, f" with --friction-law {friction.law}, only with stribeck"
    if friction.law == "stribeck" and friction.static_ratio == 1.0:
        yield (
            place + "stribeck_velocity",
            ": with task.friction.static_ratio 1 friction is the same at every speed",
        )
    if len({end for _, low, high in friction.last.mixture for end in (low, high)}) == 1:
        yield place + "per", ": every robot has the same multiplier, and so has every joint"
    if friction.spread == (1.0, 1.0):
        yield place + "spread", ": a factor of 1 changes nothing"
    if friction.load is not None and not friction.draws_load:
        yield place + "load", ": a coefficient of 0 is no friction"


def _task(cfg: TrainCfg) -> Idle:
    """Yield what belongs to a task that is told, pushed, driven or commanded otherwise."""
    task, place = cfg.task, "task.randomization."
    randomization = task.randomization
    if not task.known_friction:
        yield place + "known_friction", " without --task.known-friction"
    between = round(randomization.push_interval / task.control_period)
    if not between:
        yield (
            place + "push_velocity",
            f": with --set task.randomization.push_interval={randomization.push_interval:g} no robot is pushed",
        )
        if randomization.push_interval:
            yield (
                place + "push_interval",
                f": it is less than a control period, {task.control_period:g} s, and no robot is pushed; 0 says so",
            )
    elif between >= round(task.episode / task.control_period):
        yield place + "push_velocity", f": an episode of {task.episode:g} s is over before the first push"
    if not randomization.push_velocity:
        yield place + "push_interval", ": with --set task.randomization.push_velocity=0 no robot is pushed"
    if cfg.actuator is not None:
        for name in ("stiffness", "action_delay"):
            yield place + name, " with --actuator: it is in the net"
    if task.commands.standing_share == 1 and task.terrain.kind == "flat":
        for name in _but(cfg, "task.commands", "standing_share"):
            yield name, ": with --set task.commands.standing_share=1 every robot is told to stand"


def _run(cfg: TrainCfg) -> Idle:
    """Yield what belongs to another device, or to an end that nobody asked for."""
    if cfg.device == "cpu":
        yield "contacts", " with --device cpu, only on MuJoCo Warp"
    if cfg.stop.tracking_error is None:
        for name in _but(cfg, "stop", "tracking_error"):
            yield name, " without --stop-at-tracking-error"
        return
    last = round(cfg.task.friction.last.begin * cfg.teacher.iterations)
    longest = max(cfg.teacher.iterations - last, cfg.student.iterations)
    if cfg.stop.iterations >= longest:
        why = f"it is judged over --set stop.iterations={cfg.stop.iterations}, and no phase has more than {longest}"
        yield "stop.tracking_error", f": {why} with the friction of the last stage"
