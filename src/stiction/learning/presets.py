"""The presets of `stiction train`."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from stiction.files.method import find_method, method_names
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.robots.physics import EXACT, FAST
from stiction.task.config import RandomizationCfg, TaskCfg

PresetName = Literal["full", "quick", "two-phase", "paper"]

_SHOWN = TrainCfg(video_every=100)

_ONE_PHASE = replace(
    _SHOWN,
    task=TaskCfg(estimated_friction=True, randomization=RandomizationCfg(contact_time=(0.01, 0.03))),
    teacher=TeacherCfg(latent="history", iterations=1000, final_std=0.2, velocity_weight=10.0, quiet=30),
    student=StudentCfg(iterations=0),
    network=NetworkCfg(estimator_frame=32, estimator=(128, 64)),
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
"""`full` and `quick` are one phase: what walks is what will be deployed, on its own z* and its own estimate of velocity
and friction, with little noise in the end and at last with none, and on ground that is another for each robot.
`two-phase` is the paper's teacher and student at the budget with which its claims were judged; `paper` has more of it,
and draws the paper's table and the noise of sensors. All make clips. `two-phase` simulates joint friction by yielding
springs, which is faster; the others by the solver's rows, by which everything is judged: a student that walked on
springs alone is slower than it is told where friction is high, see results/student."""


def preset(name: str, device: str = "cpu", method: str | None = None, engine: str = "mujoco") -> TrainCfg:
    """Return a preset; off the processor and in other engines, where there are no sliders, with rows.

    Other engines have contacts of their own, whose softness nobody draws. For a method of another distribution, the
    preset that it makes of this one; the method itself is not set.
    """
    cfg = PRESETS[name]
    if method in method_names():
        cfg = find_method(method).preset(cfg)
    if engine != "mujoco":
        ground = replace(cfg.task.randomization, contact_time=RandomizationCfg().contact_time)
        cfg = replace(cfg, task=replace(cfg.task, randomization=ground))
    # The yielding joints of `FAST` are MuJoCo's own, on the host alone.
    return cfg if (device, engine) == ("cpu", "mujoco") else replace(cfg, task=replace(cfg.task, physics=EXACT))
