"""Which runs of the experiment are there, whether they are what the manifest says, and what the others cost."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from math import prod
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
from stiction.task.config import TaskCfg
from stiction_experiments.friction.manifest import Run
from stiction_experiments.methods.friction import BY_ERROR
from stiction_experiments.methods.hinf import HinfCfg

State = Literal["missing", "interrupted", "exported", "finished"]
"""`exported`: its folder is elsewhere, its policy is here."""

EVALUATED: tuple[State, ...] = ("exported", "finished")
"""States of runs that have rows."""


STEP_SECONDS = {"rows": 2.42e-4, "sliders": 1.79e-4, "physx": 1.2e-3}
"""Processor time of a training in one phase for each control step of each robot [s], with friction as rows and as
sliders: 2.97 and 2.20 s an iteration of 512 robots and 24 steps (results/speed, an AMD core; machines differ by two).
In PhysX, a robot at a time, 15 s."""

DEARER_BY = {
    "teacher": 0.88,
    "mirrored": 1.5,
    "recurrent": 1.45,
    "dreamwaq": 1.03,
    "hinf": 1.27,
    "drawn pushes": 1.13,
    "law on rows": 1.35,
    "law on sliders": 1.11,
    "go1 on rows": 0.88,
    "go1 on sliders": 0.81,
    "stairs on rows": 1.12,
    "stairs on sliders": 1.16,
    "net on rows": 0.84,
    "net on sliders": 1.15,
    "history 21": 1.11,
    "history 51": 1.57,
    "half step on sliders": 1.52,
}
"""What an iteration takes over one of the presets of one phase [1]: one of a teacher, whose encoder PPO's gradient does
not reach, or its student, 2.63 s on rows and 1.90 on sliders (results/speed); mirrored samples, 1,089 to 1,118 s for
333 where 440 take 940 to 1,000, and a recurrent encoder, 3.2 s where others take 2.2 (results/student); DreamWaQ,
1,074 and 1,082 s, and H∞ beside a disturber that learns, 1,307 to 1,369 s, where one phase takes 1,050, and random
pushes, 1,104 s where the same machine takes 975 (results/methods); a friction law that reads load or torque, by
`load` at 0.2, the dearer of the two, 3.57 s where a torque takes 2.64 and 2.11 where it takes 1.90; the smaller
robot go1, 2.32 and 1.54 s; stairs, 3.20 and 2.35 s, and an Actuator Net in place of the friction, 2.41 and 2.33 s,
where flat ground and 20 % of friction take 2.86 and 2.02; a history of 21 and of 51 steps, 33.2 and 46.8 s for
twelve iterations of a teacher and two of its student where 11 take 29.9 (results/speed); half the physics step,
28.8 s for twelve of one phase where the whole one takes 19.0."""

PASS = 0.087 / 2.20
"""What each further supervised pass over a rollout takes of such an iteration [1] (results/speed)."""


@dataclass(frozen=True)
class PlannedRun:
    """A run with its complete configuration, and the folder where it is or will be."""

    run: Run
    cfg: TrainCfg
    path: Path
    policy: Path | None = None
    """Its exported policy, where there is one."""

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

    def minutes(self) -> float | None:
        """Return the processor time that its training takes from the beginning, by `STEP_SECONDS` and `DEARER_BY`
        [min]; None where nothing like it was measured.
        """
        cfg = self.cfg
        physics = ("sliders" if cfg.task.physics.plastic else "rows") if cfg.engine == "mujoco" else cfg.engine
        factor = self._factor(physics)
        if factor is None or physics not in STEP_SECONDS or (physics == "physx" and factor != 1.0):
            return None
        steps = cfg.num_envs * sum(phase.iterations * phase.steps for phase in (cfg.teacher, cfg.student))
        return steps * factor * STEP_SECONDS[physics] / 60.0

    def _factor(self, physics: str) -> float | None:
        """Return what its iterations take over those that `STEP_SECONDS` is of [1]; None where that is not measured.

        physics: a name of `STEP_SECONDS`.
        """
        cfg, usual = self.cfg, TaskCfg()
        task = cfg.task
        hinf = cfg.method_settings if isinstance(cfg.method_settings, HinfCfg) else HinfCfg("none")
        step, halved = (task.timestep, task.decimation), (usual.timestep / 2, 2 * usual.decimation)
        robot = task.robot.partition("@")[0]
        measured = (
            step in ((usual.timestep, usual.decimation), halved)
            and robot in (usual.robot, "go1")
            and task.terrain.kind in ("flat", "stairs")
        )
        has = {
            "teacher": cfg.teacher.latent == "alternate" and cfg.engine == "mujoco",
            "mirrored": cfg.symmetry == "batches",
            "recurrent": cfg.network.recurrent,
            "dreamwaq": cfg.method.name == "dreamwaq",
            "hinf": hinf.learns,
            "drawn pushes": hinf.disturbs and not hinf.learns,
            f"law on {physics}": any(law.spec.reads for law in task.friction.laws),
            f"go1 on {physics}": robot == "go1",
            f"stairs on {physics}": task.terrain.kind == "stairs",
            f"net on {physics}": cfg.actuator is not None,
            f"history {task.history}": task.history != usual.history,
            f"half step on {physics}": step == halved,
        }
        dearer = [name for name, there in has.items() if there]
        if not measured or not DEARER_BY.keys() >= {*dearer}:
            return None
        return (1.0 + PASS * (cfg.teacher.adaptation_passes - 1)) * prod(DEARER_BY[name] for name in dearer)

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
        found, expected = (replace(cfg, joints=None, actuator=None) for cfg in (run.config_to_train(), self.cfg))
        if other := [*differences(found, expected), *self._other_files(run)]:
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
        found = contract.robot, contract.method, contract.seed, contract.friction_law, contract.friction_level
        expected = self.cfg.task.robot, friction.method, self.run.seed, friction.law, friction.level
        if found != expected:
            return f"it is {found}, expected {expected}"
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
        found = identified["sha256"] if identified else None
        try:
            expected = None if joints is None else digest_of(Path(joints))
        except OSError as error:
            raise FileError(f"{joints} cannot be read: {error}; expected the joints.json to train with") from error
        net = None if self.cfg.actuator is None else read_actuator(Path(self.cfg.actuator))
        other = differences(found, expected, "SHA-256 of joints")
        same_net = _content(run.actuator()) == _content(net)
        return other if same_net else [*other, f"actuator is another net than {self.cfg.actuator}"]


def own_files(planned: Sequence[PlannedRun]) -> list[PlannedRun]:
    """Return runs of several presets, some of which have one name and so one folder: each with that folder, and with
    its policy, only where these are surely its own.

    Raises `StictionError` for a policy that is damaged.
    """
    times, found = Counter(run.run.name for run in planned), []
    for run in planned:
        one = run
        if one.policy is not None:
            contract = read_bundle(one.policy, allow_record=True).contract
            named_alike = contract.settings is None and times[one.run.name] > 1
            if named_alike or one.why_another(contract) is not None:
                one = replace(one, policy=None)
        if times[one.run.name] > 1 and not one.is_own_folder():
            one = replace(one, path=one.path.parent / one.run.preset / one.run.name)
        found.append(one)
    return found


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
    lines, left, unknown = [], 0.0, 0
    for run, state in zip(planned, states, strict=True):
        minutes, there = run.minutes(), state in EVALUATED
        # Of a run that is elsewhere nothing is left to train.
        share = 1.0 if there else run.done() / run.iterations
        if not there:
            left += (1.0 - share) * (minutes or 0.0)
            unknown += minutes is None
        words = shlex.join(run.run.arguments)
        cost = "not measured" if minutes is None else f"{minutes:.0f} min"
        lines.append(f"{state:<12}{share:>5.0%}{cost:>14}  stiction train {words} --out {run.path}")
    missing = sum(state not in EVALUATED for state in states)
    seeds = len({run.run.seed for run in planned})
    others = f", and {unknown} runs whose cost was not measured" if unknown else ""
    return [
        *lines,
        f"{len(planned)} runs, of up to {seeds} seeds; {missing} are missing, some {left / 60.0:.1f} hours of one core"
        f"{others} (by results/speed, student and methods; machines differ by a factor of two)",
    ]


def _content(net: ActuatorNet | None) -> Any:
    """Return all of a net, for comparison, but the command and the revision that made it."""
    if net is None:
        return None
    arrays = [array.tolist() for group in net.layers for layer in group for array in layer]
    return vars(net) | {"layers": arrays, "revision": None, "command": None}


def differences(found: Any, expected: Any, name: str = "") -> list[str]:
    """Return the fields in which two configurations differ, as `teacher.iterations is 3, expected 350`."""
    if is_dataclass(found) and is_dataclass(expected):
        nested = (
            differences(getattr(found, f.name), getattr(expected, f.name), f"{name}.{f.name}".lstrip("."))
            for f in fields(found)
        )
        return [text for texts in nested for text in texts]
    return [] if found == expected else [f"{name} is {found}, expected {expected}"]
