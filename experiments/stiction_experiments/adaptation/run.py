"""The study of adaptation, run by run; finished runs are cached in the study's folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.cache import key_of, read_entry, sealed
from stiction.core.errors import ConfigurationError
from stiction.core.files import write_text
from stiction.deploy.wear import Moments
from stiction.evaluation.evaluate import RUN_WALK_CODE, EvaluationCfg
from stiction.evaluation.export import contract_of
from stiction.evaluation.summary import check_names
from stiction.learning.config import TrainCfg
from stiction.learning.run import RunDirectory, identified_values, write_json
from stiction.learning.runner import load_actor
from stiction_experiments.adaptation.monitor import LEAST_R2, fit_monitor, latent_effects, over_seeds, seeds_interval
from stiction_experiments.adaptation.probes import FrictionWalk, Per, WalkCfg, probe_walk, walk_with_friction
from stiction_experiments.methods import CODE

Progress = Callable[[str, float], None]
"""Called with the name of a piece of work and the share of it that is done."""

FEWEST_ROBOTS, SHORTEST_WALK = 32, 10.5
"""Minimum of a probed walk: robots, eight of them to test on, and length, a window of the monitor [s]."""

PROBING = (
    *(*RUN_WALK_CODE, "task/*.py", "deploy/wear.py", CODE),
    *("stiction_experiments:adaptation/*.py", "stiction_experiments:lab/trained.py"),
)
"""Code that decides what a run's part is."""


@dataclass(frozen=True)
class AdaptationCfg:
    """Settings of the study, the same for every run."""

    evaluation: EvaluationCfg = field(
        default_factory=lambda: EvaluationCfg(friction_levels=(0.0, 0.1, 0.2, 0.3), episodes=16, seconds=10.0)
    )
    """The walks on latents of their own and from elsewhere."""
    walk: WalkCfg = field(default_factory=WalkCfg)
    """The walks that are probed."""

    def __post_init__(self) -> None:
        """Refuse what leaves nothing to swap or to split."""
        if len(self.evaluation.friction_levels) < 2 or self.evaluation.episodes < 2:
            raise ConfigurationError(
                "latents are swapped between friction levels and episodes; give at least two of each"
            )
        if self.walk.robots < FEWEST_ROBOTS or self.walk.seconds - self.walk.settle < SHORTEST_WALK:
            raise ConfigurationError(
                f"{self.walk.robots} robots for {self.walk.seconds:g} s: a probe needs at least {FEWEST_ROBOTS} of "
                f"them, and {SHORTEST_WALK:g} s beside the {self.walk.settle:g} s to settle"
            )


def study(
    runs: Sequence[Path], out: Path, cfg: AdaptationCfg, threads: int, progress: Progress = lambda name, share: None
) -> dict[str, Any]:
    """Study every run; return the summary. Each run's part is cached in `out` as RUN.json and RUN-wear.json.

    Raises:
        StictionError: a run without a finished student, or two of the same name.

    """
    check_names([run.resolve().name for run in runs], "runs")
    trained = [RunDirectory(run).config() for run in runs]
    for run in runs:
        RunDirectory(run).check_finished("student")
    parts = [study_run(run, out, cfg, threads, progress) for run in runs]
    seeds = same_but_for_seed([(part["method"], config) for part, config in zip(parts, trained, strict=True)])
    methods = {}
    for method, members in seeds.items():
        same = [parts[index] for index in members]
        effects, names = over_seeds([part["latents"] for part in same]), [part["name"] for part in same]
        methods[method] = {"runs": names, "effects": effects, "probes": pooled_probes(same)}
    return {
        "config": asdict(cfg),
        "threshold": LEAST_R2,
        "methods": methods,
        "runs": {part["name"]: part for part in parts},
    }


def same_but_for_seed(runs: Sequence[tuple[str, TrainCfg]]) -> dict[str, list[int]]:
    """Return the runs that are samples of one training, by number: all of their configuration but the seed is equal.

    runs: method and configuration. The name is the method, with a number where several trainings share it: another
    friction range, budget or robot is another training, and no seed.
    """
    groups: dict[str, list[int]] = {}
    for index, (_, cfg) in enumerate(runs):
        groups.setdefault(repr(replace(cfg, seed=0)), []).append(index)
    methods = [runs[members[0]][0] for members in groups.values()]
    names = [
        method if methods.count(method) == 1 else f"{method} {methods[: number + 1].count(method)}"
        for number, method in enumerate(methods)
    ]
    return dict(zip(names, groups.values(), strict=True))


def study_run(run: Path, out: Path, cfg: AdaptationCfg, threads: int, progress: Progress) -> dict[str, Any]:
    """Return one run's part: `latents`, `probes`, `wear`; read from `out` where the same was done before.

    Of a policy without a latent `latents` has no walks: nothing of it can be swapped.
    """
    directory, name = RunDirectory(run), run.resolve().name
    header, train = directory.header(), directory.config()
    student = directory.student_digest()
    key = key_of({"config": asdict(cfg), "student": student, "run": directory.walks_by()}, *PROBING)
    file = out / f"{name}.json"
    if (done := read_entry(file, key)) is not None:
        progress(name, 1.0)
        return done
    latents: dict[str, Any] = {"rows": [], "effects": []}
    if train.network.latent:
        latents = latent_effects(run, cfg.evaluation, threads, lambda share: progress(f"{name}: latents", share))
    contract, actor = contract_of(train, header), load_actor(directory, "student")
    moments = Moments(contract.observation, contract.scale)
    identified = identified_values(header)
    probes: list[dict[str, Any]] = []
    walks: dict[Per, FrictionWalk] = {}
    pers: tuple[Per, ...] = ("joint", "robot")
    for per in pers:
        share = partial(_part_done, progress, f"{name}: friction per {per}")
        walks[per] = walk_with_friction(train, identified, actor, per, cfg.walk, threads, partial(share, 0.0))
        probes += probe_walk(walks[per], moments, per, partial(share, 0.5))
    wear = fit_monitor(walks, moments, contract.joint_names, cfg.walk.highest, student)
    model = out / f"{name}-wear.json"
    model.unlink(missing_ok=True)
    if any(wear.estimated):
        write_text(model, wear.to_json())
    per_target = {field: list(getattr(wear, field)) for field in ("estimated", "determination", "coverage", "reach")}
    part = {
        "key": key,
        "name": name,
        "method": contract.method,
        "seed": contract.seed,
        "revision": contract.revision,
        "command": contract.command,
        "latents": latents,
        "probes": probes,
        "fallen": {per: walk.fallen for per, walk in walks.items()},
        "wear": {"targets": list(wear.targets), "window": wear.window * contract.control_period} | per_target,
    }
    write_json(file, sealed(part))
    return part


def _part_done(progress: Progress, name: str, begin: float, share: float) -> None:
    """Report the share of one half of a piece of work; begin: share of the whole at its beginning."""
    progress(name, begin + share / 2)


def pooled_probes(parts: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the mean R² of runs of one method, with t-intervals over seeds."""
    pooled = []
    for same in zip(*(part["probes"] for part in parts), strict=True):
        values = [probe["mean"] for probe in same]
        pooled.append(
            {name: same[0][name] for name in ("input", "row", "per", "shuffled")}
            | {"mean": float(np.mean(values)), "interval95": seeds_interval(values), "each": values}
        )
    return pooled
