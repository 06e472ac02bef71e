"""Processor time of the whole plan, from what a step of a training and a second of a walk take."""

from __future__ import annotations

from stiction.evaluation.course import PATIENCE
from stiction.evaluation.grid import parse_simulator
from stiction.files.following import COMMAND_SET
from stiction.files.velocity import parse_command
from stiction.learning.arguments import parse
from stiction.learning.config import TrainCfg
from stiction.task.terrain import LENGTH
from stiction_experiments.paper import climbs, lives
from stiction_experiments.paper.plan import (
    COHORT,
    GAIT_WALKS,
    GAITS,
    PLACES,
    RUNS,
    SECONDS,
    TRAININGS,
    VIRTUAL,
    WORN,
    Training,
)

ENGINES = {"mujoco": 0.011, "physx": 0.16, "ode-webots": 0.5}
"""Processor time of a second of one robot's walk [1], by engine (results/paper/ledger.csv); in MuJoCo many walk at
once."""

ON_ROBOT = 0.45
"""The same on a virtual robot, whose physics has steps of 1 ms [1]."""

STEP_SECONDS = {"rows": 2.42e-4, "sliders": 1.5e-4, "physx": 1.2e-3}
"""Processor time of a training in one phase for each control step of each robot [s], with friction as rows, as
sliders, and in PhysX, a robot at a time. Machines differ by two; methods, robots and encoders take 0.8 to 1.6 of it."""

FITTING = 60.0
"""Processor time of fitting an Actuator Net [s]."""


def plan_seconds() -> dict[str, float]:
    """Return the processor time of every kind of work of the plan [s]."""
    seeds = {training.name: len(training.seeds) for training in TRAININGS}
    crossing = PATIENCE * LENGTH / parse_command(climbs.COMMAND).speed
    life = lives.life_cfg(VIRTUAL)
    walks = len(life.robots) * len(life.commands) * (life.wear.seconds + life.window)
    return {
        "trainings": sum(len(t.seeds) * training_seconds(t) for t in TRAININGS if t not in COHORT),
        "nets": sum(len(t.seeds) * (FITTING + RUNS * SECONDS * ON_ROBOT) for t in TRAININGS if t.net),
        "walks": sum(
            seeds[training.name] * len(place.levels_of(training)) * len(COMMAND_SET) * place.episodes * SECONDS
            * _engine(place.engine) * (2 if place.forward and training.name == "none" else 1)
            for place in PLACES
            for training in TRAININGS
            if place.takes(training)
        ),
        "stairs": sum(
            sum(seeds[name] for name in place.trainings) * len(place.levels) * len(place.heights)
            * place.episodes * max(1, len(place.robots)) * crossing * _engine(place.engine)
            for place in climbs.STAIRS
        ),
        "lives": sum(seeds[name] for name in WORN) * walks * ON_ROBOT,
        "gaits": sum(seeds[name] for name in GAITS) * GAIT_WALKS * SECONDS * ENGINES["mujoco"],
    }  # fmt: skip


def processor_seconds(cfg: TrainCfg) -> float:
    """Return the processor time of a training from the beginning, by `STEP_SECONDS` [s]."""
    physics = ("sliders" if cfg.task.physics.plastic else "rows") if cfg.engine == "mujoco" else cfg.engine
    steps = cfg.num_envs * sum(phase.iterations * phase.steps for phase in (cfg.teacher, cfg.student))
    return steps * STEP_SECONDS[physics]


def training_seconds(training: Training) -> float:
    """Return the processor time of one seed of a training [s], on a net as on sliders."""
    words = [word for word in training.words if word not in ("--actuator", "{net}")]
    return processor_seconds(parse(["--preset", training.preset, *words, "--seed", "10"]).config)


def _engine(name: str) -> float:
    """Return the processor time of a second of a walk in an engine, perhaps on a virtual robot [1]."""
    return ON_ROBOT if "+" in name else ENGINES[parse_simulator(name).engine]
