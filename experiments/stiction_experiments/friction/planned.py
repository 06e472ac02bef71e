"""Existing runs of the experiment, their differences from the manifest, and the cost of the missing ones."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Literal, Self

from stiction.core.errors import ConfigurationError, FileError, TrainingError
from stiction.core.files import digest_of
from stiction.evaluation.policies import method_of
from stiction.files.actuator import read_actuator
from stiction.files.bundle import Bundle, read_bundle
from stiction.files.contract import Contract
from stiction.files.results import read_metrics
from stiction.joints.net import ActuatorNet
from stiction.learning.config import TrainCfg
from stiction.learning.identity import difference, settings_of
from stiction.learning.run import RunDirectory, latest_checkpoint
from stiction_experiments.friction.manifest import Run
from stiction_experiments.methods.friction import BY_ERROR

State = Literal["missing", "interrupted", "exported", "finished"]
"""`exported`: its folder is elsewhere, its policy is here."""

EVALUATED: tuple[State, ...] = ("exported", "finished")
"""States of runs that have rows."""


STEP_SECONDS = {"rows": 2.42e-4, "sliders": 1.79e-4, "physx": 1.2e-3}
"""Processor time of a training in one phase for each control step of each robot [s], with friction as rows and as
sliders: 2.97 and 2.20 s an iteration of 512 robots and 24 steps (results/speed, an AMD core). In PhysX, a robot at a
time, 15 s. Machines differ by two; methods, robots and encoders take 0.8 to 1.6 of it (results/student, methods)."""


def processor_seconds(cfg: TrainCfg) -> float:
    """Return the processor time of a training from the beginning, by `STEP_SECONDS` [s]."""
    physics = ("sliders" if cfg.task.physics.plastic else "rows") if cfg.engine == "mujoco" else cfg.engine
    steps = cfg.num_envs * sum(phase.iterations * phase.steps for phase in (cfg.teacher, cfg.student))
    return steps * STEP_SECONDS[physics]


@dataclass(frozen=True)
class PlannedRun:
    """A run with its complete configuration, and the folder where it is or will be."""

    run: Run
    cfg: TrainCfg
    path: Path
    policy: Path | None = None

    @classmethod
    def of(cls, run: Run, runs: Path, policies: Sequence[Path] = ()) -> Self:
        """Return a run as `stiction train` reads its arguments; runs is the folder of all, policies are those of
        exported ones: the first that has one of this name counts.
        """
        policy = next((folder / run.name for folder in policies if (folder / run.name).is_dir()), None)
        return cls(run, run.configuration(), runs / run.name, policy)

    @property
    def iterations(self) -> int:
        """Iterations of teacher and student together."""
        return self.cfg.teacher.iterations + self.cfg.student.iterations

    def done(self) -> int:
        """Return the iterations that its metrics have."""
        rows = read_metrics(self.path / "metrics.jsonl")
        if not rows:
            return 0
        before = self.cfg.teacher.iterations if rows[-1]["phase"] == "student" else 0
        return before + int(rows[-1]["iteration"])

    def minutes(self) -> float:
        """Return the processor time that its training takes from the beginning [min]."""
        return processor_seconds(self.cfg) / 60.0

    def state(self) -> State:
        """Return where the run stands.

        A configuration that was written before a field existed equals the manifest's when the field has its default. A
        `joints.json` and an Actuator Net are known by their content, and may have moved.

        Raises:
            StictionError: the folder holds a run with another configuration, joints or net, or one of the manifest's
                cannot be read.

        """
        if not (self.path / "config.json").exists():
            return "missing" if self.policy is None else "exported"
        run = RunDirectory(self.path)
        actual, expected = (replace(cfg, joints=None, actuator=None) for cfg in (run.config_to_train(), self.cfg))
        if other := [*differences(actual, expected), *self._other_files(run)]:
            raise TrainingError(
                f"{self.path} holds another run than the manifest's: {', '.join(other)}; "
                "move it away, or name another folder with --runs"
            )
        newest = latest_checkpoint(self.path / "checkpoints", "student")
        last = newest is not None and int(newest.stem.rpartition("_")[2]) == self.cfg.student.iterations
        return "finished" if last and (self.path / "summary.json").is_file() else "interrupted"

    def is_own_folder(self) -> bool:
        """Return whether its folder holds this run, or nothing."""
        try:
            self.state()
        except TrainingError:
            return False
        return True

    def bundle(self) -> Bundle:
        """Return the exported policy.

        Raises `StictionError` where there is none, it is damaged, or it says that it is of another run: by what the
        contract says of friction and, where it has them, by its settings.
        """
        if self.policy is None:
            raise FileError(f"{self.run.name} has no exported policy; name the folder of the policies with --policies")
        bundle = read_bundle(self.policy, allow_record=True)
        if why := self.why_another(bundle.contract):
            raise ConfigurationError(f"{self.policy} is another policy than the manifest's: {why}")
        return bundle

    def why_another(self, contract: Contract) -> str | None:
        """Return what makes a policy another run's, and what to do; None where it is this one's."""
        friction = self.cfg.task.friction
        actual = contract.robot, contract.method, contract.seed, contract.friction_law, contract.friction_level
        expected = self.cfg.task.robot, friction.method, self.run.seed, friction.law, friction.level
        if actual != expected:
            return f"it is {actual}, expected {expected}"
        if method_of(contract) == BY_ERROR:
            return (
                "its friction was added by the position error, expected by the joint's speed; move it away, or name "
                "another folder with --policies"
            )
        if self.cfg.method.name == "hinf" and contract.settings is None:
            return (
                "its constraint asked for nothing, as that of every hinf policy from before bundles had their "
                "settings; move it away, and train it anew"
            )
        if other := difference(contract.settings, settings_of(self.cfg)):
            return (
                f"it was trained with {other[0]}, expected {other[1]}; move it away, or name another folder with "
                "--policies"
            )
        return None

    def _other_files(self, run: RunDirectory) -> list[str]:
        """Return in which of the files that a training starts from a run differs from the manifest."""
        identified, joints = run.header()["identified"], self.cfg.joints
        digest = identified["sha256"] if identified else None
        try:
            expected = None if joints is None else digest_of(Path(joints))
        except OSError as error:
            raise FileError(f"{joints} cannot be read: {error}; expected the joints.json to train with") from error
        net = None if self.cfg.actuator is None else read_actuator(Path(self.cfg.actuator))
        other = differences(digest, expected, "SHA-256 of joints")
        same_net = _content(run.actuator()) == _content(net)
        return other if same_net else [*other, f"actuator is another net than {self.cfg.actuator}"]


def own_files(planned: Sequence[PlannedRun]) -> list[PlannedRun]:
    """Return runs of several presets, some of which have one name and so one folder: each with that folder, and with
    its policy, only where these are surely its own.

    Raises `StictionError` for a policy that is damaged.
    """
    times, files = Counter(run.run.name for run in planned), []
    for run in planned:
        one = run
        if one.policy is not None:
            contract = read_bundle(one.policy, allow_record=True).contract
            named_alike = contract.settings is None and times[one.run.name] > 1
            if named_alike or one.why_another(contract) is not None:
                one = replace(one, policy=None)
        if times[one.run.name] > 1 and not one.is_own_folder():
            one = replace(one, path=one.path.parent / one.run.preset / one.run.name)
        files.append(one)
    return files


def unrecorded(planned: Sequence[PlannedRun]) -> list[str]:
    """Return the names of the exported policies whose settings are not recorded: they are taken at their names.

    Raises as `PlannedRun.bundle`.
    """
    exported = (run for run in planned if run.state() == "exported")
    return [run.run.name for run in exported if run.bundle().contract.settings is None]


def plan_lines(planned: Sequence[PlannedRun], states: Sequence[State]) -> list[str]:
    """Return a line for each run, with its state, its cost and the command that trains it by hand; then one that says
    what is missing in all. states: `PlannedRun.state` of each.
    """
    lines, left = [], 0.0
    for run, state in zip(planned, states, strict=True):
        # Of a run that is elsewhere nothing is left to train.
        share = 1.0 if state in EVALUATED else run.done() / run.iterations
        left += (1.0 - share) * run.minutes()
        words = shlex.join(run.run.arguments)
        lines.append(f"{state:<12}{share:>5.0%}{run.minutes():>9.0f} min  stiction train {words} --out {run.path}")
    missing = sum(state not in EVALUATED for state in states)
    seeds = len({run.run.seed for run in planned})
    return [
        *lines,
        f"{len(planned)} runs, of up to {seeds} seeds; {missing} are missing, some {left / 60.0:.1f} hours of one core "
        "(by results/speed; machines differ by a factor of two, methods by up to 1.6)",
    ]


def _content(net: ActuatorNet | None) -> Any:
    """Return all of a net, for comparison, but the command and the revision that made it."""
    if net is None:
        return None
    arrays = [array.tolist() for group in net.layers for layer in group for array in layer]
    return vars(net) | {"layers": arrays, "revision": None, "command": None}


def differences(actual: Any, expected: Any, name: str = "") -> list[str]:
    """Return the fields in which two configurations differ, as `teacher.iterations is 3, expected 350`."""
    if is_dataclass(actual) and is_dataclass(expected):
        nested = (
            differences(getattr(actual, f.name), getattr(expected, f.name), f"{name}.{f.name}".lstrip("."))
            for f in fields(actual)
        )
        return [text for texts in nested for text in texts]
    return [] if actual == expected else [f"{name} is {actual}, expected {expected}"]
