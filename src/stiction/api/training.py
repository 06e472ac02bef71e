"""A policy that copes with friction: `stiction train` and `stiction export` in Python."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from markupsafe import Markup

from stiction.api.identification import Identified
from stiction.api.options import public, several
from stiction.api.policy import LoadedPolicy, load_policy
from stiction.api.result import Result, html_table
from stiction.core.effects import exclusion
from stiction.core.errors import ConfigurationError
from stiction.core.gemm import open_fast_gemm
from stiction.core.lock import output_folder, replaced_folder
from stiction.files.joints import read_training
from stiction.learning.config import TrainCfg
from stiction.learning.presets import PresetName, check_settings
from stiction.learning.presets import preset as preset_of

if TYPE_CHECKING:
    from stiction.learning.ranks import Ranks
    from stiction.learning.run import RunDirectory

Watch = Callable[..., Any]
"""Called after every iteration; see `stiction.learning.phase.Progress`."""


@dataclass(frozen=True, repr=False)
class Trained(Result):
    """A finished run."""

    path: Path
    """Folder of the run: config.json, metrics.jsonl, tensorboard/, checkpoints/, summary.json."""
    summary: dict[str, Any]
    """Content of summary.json."""

    @property
    def last(self) -> dict[str, Any]:
        """Figures of the student's last iteration; of a run of one phase, of its only one."""
        phases = self.summary["last"]
        return phases.get("student", phases["teacher"])

    def lines(self) -> Sequence[str]:
        """Return where it is, and how the student walks."""
        walks = f"tracking error {self.last['walk/tracking_error']:.3f} m/s, falls and gait in metrics.jsonl"
        return f"run in {self.path}", walks, f"{self.summary['seconds'] / 60:.1f} min"

    def metrics(self) -> list[dict[str, Any]]:
        """Return the figures of every iteration, in order, as any data frame takes them."""
        from stiction.files.results import read_metrics

        return read_metrics(self.path / "metrics.jsonl")

    def to_dict(self) -> dict[str, Any]:
        """Return what `stiction train --json` prints, and `summary.json` holds."""
        return self.summary

    def table(self) -> Markup:
        """Return the last iteration's figures."""
        rows = [(name, f"{value:.4g}") for name, value in self.last.items() if isinstance(value, float)]
        return html_table(("figure", "last iteration"), rows)

    def write(self, folder: Path) -> None:
        """Refuse: a run is in its folder from its first iteration on."""
        raise ConfigurationError(f"the run is in {self.path} already; export(run) makes its bundle")


@public
def train(
    out: str | Path,
    *,
    robot: str | Path = "saturn_lite",
    method: str | None = None,
    friction_level: float | None = None,
    friction_from: Identified | str | Path | None = None,
    joints: str | Path | None = None,
    joint_map: str | Sequence[str] = (),
    preset: PresetName = "full",
    config: TrainCfg | None = None,
    seed: int = 0,
    device: Literal["cpu", "cuda", "warp-cpu"] = "cpu",
    say: Callable[[str], None] = lambda line: None,
    progress: Watch = lambda *_: None,
) -> Trained:
    """Train a policy that walks, with or without friction in its joints. Needs the extra `train`.

    Args:
        out: folder of the run. One that was interrupted goes on with `stiction train --resume`.
        robot: a shipped robot, a file of your own, or `module:NAME`, which runs that module.
        method: `none`, `direct`, `deception`, ...; how friction is drawn.
        friction_level: nominal friction as a fraction of each joint's torque limit.
        friction_from: an identification, or its `training.json`, in place of `method` and `friction_level`.
        joints: a `joints.json` whose inertia, damping and friction become the robot's nominal ones.
        joint_map: RECORDED=JOINT pairs where its records have other names.
        preset: defaults of everything else: `quick` is 12 to 25 minutes of one core, `full` over twice that.
        config: everything else, in place of `preset`, such as `replace(stiction.learning.presets.preset("quick"),
            num_envs=256)`.
        seed: of everything random in the run.
        device: where it is simulated.
        say: called with a sentence that you should know.
        progress: called after every iteration.

    Raises `StictionError`: it cannot be trained, the folder holds a run already, or training has diverged.

    >>> import stiction
    >>> stiction.train("runs/a", method="direct", friction_level=0.0)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    stiction.core.errors.ConfigurationError: --method direct at --friction-level 0 trains without friction; ...

    """
    # Before torch, which these bring in.
    open_fast_gemm()
    from stiction.learning.run import identified_values
    from stiction.learning.runner import train as run_training

    base_config = preset_of(preset, device, method) if config is None else config
    cfg = replace(base_config, seed=seed, device=device, joints=base_config.joints if joints is None else str(joints))
    cfg = replace(cfg, task=replace(cfg.task, robot=str(robot)))
    if method is not None or friction_level is not None:
        if friction_from is not None:
            raise ConfigurationError(exclusion("friction_from", "method or friction_level"))
        old = cfg.task.friction
        friction = replace(
            old, method=method or old.method, level=old.level if friction_level is None else friction_level
        )
        cfg = replace(cfg, task=replace(cfg.task, friction=friction))
    base = base_config if config is None else None
    run, cfg = begin(Path(out), cfg, base, "stiction.train(...)", friction_from, several(joint_map), say)
    with output_folder(run.path):
        return Trained(run.path, run_training(cfg, run, identified_values(run.header()), progress))


def begin(
    out: Path,
    cfg: TrainCfg,
    base: TrainCfg | None,
    command: str,
    friction_from: Identified | str | Path | None = None,
    joint_map: tuple[str, ...] = (),
    say: Callable[[str], None] = lambda line: None,
    ranks: Ranks | None = None,
) -> tuple[RunDirectory, TrainCfg]:
    """Make the folder of a new run, with the friction that an identification proposes; return it with what it trains.

    base: the configuration before anybody changed it, by default that of any preset; command: words that asked for the
    run; ranks: processes that train it, by default this one. Raises as `train`, and `ConfigurationError` for a setting
    without effect.
    """
    from stiction.learning.begin import begin_run, with_friction
    from stiction.learning.ranks import ALONE

    if friction_from is not None:
        cfg = with_friction(cfg, *_proposal(friction_from))
        base = base and replace(base, task=replace(base.task, friction=cfg.task.friction))
    check_settings(cfg, base)
    return begin_run(out, cfg, command, joint_map, say, ranks or ALONE)


def _proposal(source: Identified | str | Path) -> tuple[dict[str, Any], str]:
    """Return what a `training.json` holds, and what messages call it."""
    if not isinstance(source, Identified):
        return read_training(Path(source)), Path(source).name
    # As a file would hold it: tuples become lists, as the reader expects them.
    proposed = json.loads(json.dumps(source.training))
    if proposed["friction"] is None:
        raise ConfigurationError(f"the identification proposes no training: {proposed['text']}")
    return proposed, "the identification"


@public
def export(
    run: Trained | str | Path,
    *,
    out: str | Path | None = None,
    joints: str | Path | None = None,
    joint_map: str | Sequence[str] = (),
    wear: str | Path | None = None,
    robot: str | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> LoadedPolicy:
    """Export the student of a run as a policy bundle, check it as `verify` does, and return it.

    It needs the extra `train`.

    Args:
        run: from `train`, or its folder.
        out: folder of the bundle; by default `bundle` within the run.
        joints: for a policy that is told its joints' friction, the `joints.json` of the robot that it is for.
        joint_map: RECORDED=JOINT pairs where its records have other names.
        wear: the map of the wear monitor.
        robot: the robot that the run names as a module, said again: a module that a file names is not run.
        say: called with a sentence that you should know.

    Raises `StictionError`: the run is not finished, or was altered.

    >>> import stiction
    >>> stiction.export("runs/none")
    Traceback (most recent call last):
    stiction.core.errors.FileError: no run in runs/none; expected a folder that `stiction train` made

    """
    from stiction.evaluation.export import export_run
    from stiction.learning.run import RunDirectory

    folder = run.path if isinstance(run, Trained) else Path(run)
    RunDirectory(folder).header()  # where there is no run, no folder is made beside it
    target = folder / "bundle" if out is None else Path(out)
    known, monitor = (None if path is None else Path(path) for path in (joints, wear))
    with replaced_folder(target):
        export_run(folder, target, monitor, known, several(joint_map), say, robot)
    return load_policy(target)


__all__ = ["Trained", "export", "train"]
