"""The options of `stiction train`, and how they are read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, make_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from stiction.core.effects import needs
from stiction.core.flags import FLAT
from stiction.core.options import ParsedArguments, read_parsed
from stiction.files.method import installed_methods
from stiction.learning.config import TrainCfg
from stiction.learning.presets import PresetName, check_settings, preset

DESCRIPTION = """Train a policy that walks on what the robot measures, with or without friction in its joints.

Examples; the first takes 12 to 25 minutes of one core, the second over twice that:
  stiction train --preset quick --method deception --friction-level 0.2 --out runs/first
  stiction train --robot robot.yaml --friction-from identified/training.json --out runs/mine
  stiction train --resume runs/mine

The presets full and quick learn in one phase. The paper's two, a teacher (PPO, sees everything) and its student
(behaviour cloning), are those of --preset two-phase; terrain wants it: its teacher sees the ground.

Watch it: the terminal shows the time left, a busy machine and how the robots walk (`nohup stiction train ... 2>
train.log &` writes a line every 30 s); report.html in the run's folder shows curves and the newest clip, and reloads
itself. `tensorboard --logdir runs`, or another --logger, shows every figure: reward/* (weighted terms), walk/*
(tracking error, tripod share, falls), latent/explained (two phases; 1: the history tells all that the privileged
encoder says), estimator/velocity_error [m/s], estimator/friction_error, friction/low, high and mean (multipliers of the
nominal friction), terrain/*, those of an installed method, and rsl_rl's Train/mean_reward and Train/mean_episode_length
(last 100 episodes). A short clip of the policy at 0.5 m/s appears in clips/ every 100 iterations; --view lets the
newest checkpoint walk in the browser.

Stop it: Ctrl-C or SIGTERM ends it after the iteration, with a checkpoint and exit status 130 or 143; kill -9 costs the
iterations since the last checkpoint. `stiction train --resume runs/deception` goes on to the same parameters, bit for
bit. A run that diverges ends with status 1 and says what it saw, since when, and what to try. `torchrun
--nproc-per-node 2 -m stiction train ...` shares the robots among processes.

Everything that has no flag is a setting: `--set teacher.gamma=0.98`, as often as needed, or a YAML or JSON file with
`--config FILE`; `stiction train --set help` lists all of them, `--preset quick --set help` as that preset has them. A
preset comes before the file, the file before --set and flags; a field given by both of these is refused.

The run holds config.json, metrics.jsonl (a line an iteration), tensorboard/, checkpoints/, clips/, report.html,
curves.png and, when it is finished, summary.json. `stiction runs` lists and compares runs. Next: `stiction export
runs/deception`."""


GROUPS = {
    "usually needed": ("--robot", "--method", "--friction-level", "--friction-from", "--preset", "--out", "--seed"),
    "the joints": ("--joints", "--actuator", "--friction-law"),
    "ground and physics": ("--terrain", "--physics", "--engine", "--symmetry"),
    "how it runs": ("--num-envs", "--device", "--resume", "--video-every", "--logger", "--view", "--json"),
}


@dataclass(frozen=True)
class Train:
    """Options of `stiction train`."""

    config: Annotated[TrainCfg, FLAT] = field(default_factory=TrainCfg)
    """The whole configuration."""
    preset: PresetName = "full"
    """Defaults for everything else. `quick`: one phase of 440 iterations, 12 to 25 minutes of one core. `full`:
    1000 of them. `two-phase`: a teacher (350 iterations), then its student (80), as the paper's claims were judged.
    `paper`: 700 and 240, and draws the paper's table, with noise of the sensors."""
    out: Path = Path("runs/train")
    """Folder of the run."""
    joint_map: tuple[str, ...] = ()
    """RECORDED=JOINT pairs where the records of --joints have other names than the robot's joints; the right side may
    have wildcards, as in shank=*_calf_joint."""
    friction_from: Path | None = None
    """A `training.json` of `stiction identify`; its method and level go in place of --method and --friction-level."""
    resume: Path | None = None
    """Continue the run in this folder; all other options come from its config.json."""
    view: bool = False
    """Watch the newest checkpoint in the browser (extra view); as `stiction view RUN --follow` does: a process of its
    own, at a low priority, that computes nothing while no browser looks."""
    json: bool = False
    """Print the summary on standard output, and nothing else there; progress goes to standard error."""


def parse(arguments: list[str]) -> Train:
    """Return the options of `stiction train`. Raises `ConfigurationError` where one would have no effect."""
    return parse_given(arguments)[0]


def parse_given(arguments: list[str]) -> tuple[Train, TrainCfg, ParsedArguments]:
    """Return the options, the configuration with which they began, and the typed words. Raises as `parse`."""
    methods = {method.name: method.settings for method in installed_methods() if method.settings is not None}
    kind = _options_with(tuple(methods.items()))

    def begin(typed: Mapping[str, Any]) -> Train:
        """Return the defaults of all options, which preset, device, engine and method change."""
        name, method = typed.get("preset", "full"), typed.get("task.friction.method")
        return kind(config=preset(name, typed.get("device", "cpu"), method, typed.get("engine", "mujoco")))

    options, before, typed = read_parsed(kind, arguments, "stiction train", DESCRIPTION, begin, GROUPS)
    base = kind() if before is None else before
    if (name := options.config.method.name) in methods:
        options = replace(options, config=replace(options.config, method_settings=getattr(options, name)))
    check_settings(options.config, base.config)
    return options, base.config, typed


@cache
def _options_with(methods: tuple[tuple[str, type[Any]], ...]) -> Any:
    """Return the class of the options with a group of settings for each method: one class, whose table is made once."""
    groups = [
        (name, settings, field(default_factory=settings, metadata=needs(f"--method {name}")))
        for name, settings in methods
    ]
    return make_dataclass("Train", groups, bases=(Train,), frozen=True, namespace={"__doc__": Train.__doc__})
