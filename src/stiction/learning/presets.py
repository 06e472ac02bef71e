"""The presets of `stiction train`, and the settings that have no effect beside others."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from stiction.core.effects import changed_options, check_effects, requirement
from stiction.core.errors import ConfigurationError
from stiction.core.flags import entries
from stiction.files.method import find_method, method_names
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.robots.physics import EXACT, FAST, PhysicsCfg
from stiction.task.config import CommandCfg, RandomizationCfg, TaskCfg

PresetName = Literal["full", "quick", "two-phase", "paper"]

_SHOWN = TrainCfg(video_every=100)

_ONE_PHASE = replace(
    _SHOWN,
    task=TaskCfg(
        physics=PhysicsCfg("plastic-first"),
        estimated_friction=True,
        first_side=True,
        commands=CommandCfg(forward=(-0.9, 0.9), sideways=(-0.4, 0.4), turn=(-1.2, 1.2)),
        randomization=RandomizationCfg(contact_time=(0.01, 0.01), standing_start=0.25),
    ),
    teacher=TeacherCfg(latent="history", iterations=1000, final_std=0.2, velocity_weight=10.0, quiet=30),
    student=StudentCfg(iterations=0),
    network=NetworkCfg(estimator_frame=32, estimator=(128, 64), latent=0),
    symmetry="network",
)

PRESETS = {
    "full": _ONE_PHASE,
    "quick": replace(_ONE_PHASE, teacher=replace(_ONE_PHASE.teacher, iterations=440)),
    "two-phase": replace(
        _SHOWN,
        task=TaskCfg(physics=FAST),
        teacher=replace(TeacherCfg(), iterations=350),
        student=replace(StudentCfg(), iterations=80),
    ),
    "paper": replace(_SHOWN, task=TaskCfg(randomization=RandomizationCfg.literal())),
}
"""`full` and `quick` are one phase without a latent, on sliders and then on rows, with little noise in the end and none
at last, on ground as hard as the physics step holds; commands go past those that have to be followed. `two-phase` is
the paper's teacher and student at the budget with which its claims were judged, on yielding springs, which are faster;
`paper` has more of it, the paper's table and the noise of sensors. All make clips."""


def preset(name: str, device: str = "cpu", method: str | None = None, engine: str = "mujoco") -> TrainCfg:
    """Return a preset, as a method of another distribution makes of it; the method itself is not set.

    Other engines have contacts of their own and, as other devices, no sliders.
    """
    cfg = PRESETS[name]
    if method in method_names():
        cfg = find_method(method).preset(cfg)
    if engine != "mujoco":
        ground = replace(cfg.task.randomization, contact_time=RandomizationCfg().contact_time)
        cfg = replace(cfg, task=replace(cfg.task, randomization=ground))
    # The yielding joints of `FAST` are MuJoCo's own, on the host alone.
    return cfg if (device, engine) == ("cpu", "mujoco") else replace(cfg, task=replace(cfg.task, physics=EXACT))


def check_settings(cfg: TrainCfg, base: TrainCfg | None = None) -> None:
    """Raise `ConfigurationError` for the first changed setting without effect: two runs that differ in it are the same.

    base: the configuration before anybody changed it; by default the presets' values count as unchanged. A preset may
    have such settings, and an older run: the configuration itself takes them.
    """
    method = cfg.task.friction.method
    presets = (preset(name, cfg.device, method, cfg.engine) for name in PRESETS)
    unchanged = (TrainCfg(), *presets) if base is None else (base,)
    check_effects(cfg, *unchanged)
    idle = {*cfg.method.unused} & {*changed_options(cfg, *unchanged)}
    for entry in entries(TrainCfg):
        if entry.path in idle:
            raise ConfigurationError(requirement(entry.typed, f"another --method than {method}"))
