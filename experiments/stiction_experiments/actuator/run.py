"""The paper's loop f0 -> log -> f_motor -> f1, stage by stage; stages that are done are not repeated.

    bundles/f0                  conventionally trained (runs/f0), or given
    logs/VARIANT/               f0 on the virtual robots
    nets/VARIANT-INPUTS/        f_motor, for both sets of inputs
    bundles/f1-VARIANT          trained (runs/f1-VARIANT) with that f_motor in the loop
    evaluation/POLICY.json      f0 and every f1 on all virtual robots, and on the study's own without friction

Each is written under another name and renamed, or its last file marks it as complete.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch

from stiction.core.cache import has_entry, key_of, publish_entry, read_entry, sealed
from stiction.core.errors import ConfigurationError, FileError, PolicyError
from stiction.core.files import publish
from stiction.core.provenance import num_threads
from stiction.deploy.check import check_bundle
from stiction.evaluation.evaluate import WALK_CODE, EvaluationCfg, evaluate_bundle
from stiction.evaluation.export import export_run
from stiction.evaluation.summary import describe
from stiction.evaluation.walk_logs import RecordCfg
from stiction.files.actuator import read_actuator
from stiction.files.bundle import Bundle, find_bundle, read_bundle
from stiction.joints.net import INPUT_SETS
from stiction.learning.actuator import error_of, train_actuator, write_trained
from stiction.learning.actuator_data import LoggedRun, read_run
from stiction.learning.config import TrainCfg
from stiction.learning.run import RunDirectory, write_json
from stiction.learning.runner import train
from stiction_experiments.actuator.config import LoopCfg
from stiction_experiments.actuator.robots import loop_robots, record_logs

EVALUATING = (*WALK_CODE, "stiction_experiments:actuator/robots.py")
"""Code by which policies are evaluated. Logs, nets and trainings count by what they were made of, and not by code: days
of training are of them, and go on with what they began with."""

Progress = Callable[[str, float], None]
"""Called with the name of the stage and the share of it that is done."""


class ActuatorLoop:
    """One study in one folder."""

    def __init__(self, out: Path, cfg: LoopCfg, command: str, progress: Progress = lambda name, share: None) -> None:
        """Begin or continue the study in `out`.

        Raises:
            StictionError: `out` holds a study with other options, or these cannot be run.

        """
        # Now, and not after hours of training.
        RecordCfg(1, cfg.log_seconds)
        EvaluationCfg((cfg.level,), cfg.commands, cfg.episodes, cfg.seconds)
        self.out, self.cfg, self.command, self.progress = out, cfg, command, progress
        self.robots = loop_robots(cfg.level, cfg.train.seed)
        # As they will be read from the file, where tuples are lists and paths text.
        self.options = json.loads(json.dumps(asdict(cfg), default=str))
        file = out / "study.json"
        if file.is_file():
            held = _read_options(file)
            if other := [name for name in self.options if held.get(name) != self.options[name]]:
                raise ConfigurationError(
                    f"{out} holds this study with another {', '.join(other)}; say the same options to go on, or name "
                    "another --out"
                )
        elif cfg.policy is not None:
            self._check_given(find_bundle(cfg.policy))

    def _check_given(self, path: Path) -> None:
        """Refuse a first policy that is damaged, or was made for another robot or physics step."""
        contract, task = check_bundle(path).bundle.contract, self.cfg.train.task
        if (contract.robot, contract.physics_timestep) != (task.robot, task.timestep):
            raise ConfigurationError(
                f"{path} is for {contract.robot} at steps of {contract.physics_timestep} s, the study trains "
                f"{task.robot} at {task.timestep} s; say --robot and --set task.timestep"
            )

    def run(self) -> dict[str, Any]:
        """Go through all stages that are not done; return what summary.json has."""
        torch.set_num_threads(num_threads())
        file = self.out / "study.json"
        if not file.is_file():
            write_json(file, {"options": self.options, "command": self.command})
        start = self._first_policy()
        logs = {name: self._logs(name, start) for name in self.cfg.variants}
        nets = {
            f"{name}-{inputs}": self._net(name, inputs, runs) for name, runs in logs.items() for inputs in INPUT_SETS
        }
        policies = {"f0": start}
        for name in self.cfg.variants:
            net = self.out / "nets" / f"{name}-{self.cfg.net.inputs}"
            policies[f"f1-{name}"] = self._trained(f"f1-{name}", replace(self.cfg.train, actuator=str(net)))
        robots = [vars(robot).items() for robot in self.robots]
        return {
            "options": self.options,
            "robots": [{key: round(v, 4) if isinstance(v, float) else v for key, v in items} for items in robots],
            "nets": nets,
            "cross": self._cross(logs),
            "policies": {name: describe(bundle) for name, bundle in policies.items()},
            "rows": [row for name, bundle in policies.items() for row in self._evaluate(name, bundle)],
        }

    def _first_policy(self) -> Bundle:
        """Return f0: the bundle that was given, or one trained here."""
        folder = self.out / "bundles" / "f0"
        if self.cfg.policy is None:
            return self._trained("f0", self.cfg.train)
        if not folder.exists():
            with publish(folder) as copy:
                shutil.copytree(find_bundle(self.cfg.policy), copy)
        return read_bundle(folder)

    def _trained(self, name: str, cfg: TrainCfg) -> Bundle:
        """Return a policy, trained from where its run stands."""
        folder, path = self.out / "bundles" / name, self.out / "runs" / name
        if not folder.exists():
            run = RunDirectory(path)
            if (path / "config.json").exists():
                run.resume()
            else:
                run = RunDirectory.create(path, cfg, self.command, None)
            total = cfg.teacher.iterations + cfg.student.iterations

            def report(phase: str, iteration: int, iterations: int, figures: dict[str, float]) -> None:
                done = iteration + (cfg.teacher.iterations if phase == "student" else 0)
                self.progress(f"train {name}", done / total)

            train(run.config_to_train(), run, None, report)
            export_run(path, folder)
        return read_bundle(folder)

    def _logs(self, variant: str, policy: Bundle) -> list[LoggedRun]:
        folder = self.out / "logs" / variant
        key = key_of([self.options, policy.digest])
        if not has_entry(folder, key):
            with publish_entry(folder, key, f"logs of {variant}") as logs:
                report = partial(self.progress, f"log {variant}")
                if not record_logs(policy, variant, self.cfg, logs, num_threads(), report):
                    raise PolicyError(f"f0 fell at once in every run of {variant!r}: there is nothing to fit a net to")
        return [read_run(file) for file in sorted(folder.glob("*.npz"))]

    def _net(self, variant: str, inputs: str, runs: list[LoggedRun]) -> dict[str, Any]:
        """Return the errors of a net, fitted first where it is not there."""
        folder = self.out / "nets" / f"{variant}-{inputs}"
        key = key_of([self.options, inputs, *(run.sha256 for run in runs)])
        if not has_entry(folder, key):

            def report(group: str, share: float) -> None:
                self.progress(f"net {variant}, {inputs} inputs, {group}", share)

            trained = train_actuator(runs, replace(self.cfg.net, inputs=inputs), self.command, report)  # type: ignore[arg-type]
            with publish_entry(folder, key, f"net of {variant}") as net:
                write_trained(net, trained)
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        return {name: summary[name] for name in ("rmse", "samples", "inputs", "torque_source")}

    def _cross(self, logs: dict[str, list[LoggedRun]]) -> dict[str, dict[str, float]]:
        """Return the error of every net on the runs of every data set, but those it was fitted to [of the limit]."""
        errors: dict[str, dict[str, float]] = {}
        for name in logs:
            net = read_actuator(self.out / "nets" / f"{name}-{self.cfg.net.inputs}")
            fitted = set(net.training.values())
            errors[name] = {
                other: error_of(net, [run for run in runs if run.sha256 not in fitted]) for other, runs in logs.items()
            }
        return errors

    def _evaluate(self, name: str, bundle: Bundle) -> list[dict[str, Any]]:
        """Return a policy's rows on every virtual robot, and on the study's own without friction."""
        file = self.out / "evaluation" / f"{name}.json"
        key = key_of([self.options, bundle.digest], *EVALUATING)
        done = read_entry(file, key)
        if done is None:
            rows = []
            for index, robot in enumerate(self.robots):
                levels = (0.0, robot.level) if index == 0 else (robot.level,)
                evaluated = evaluate_bundle(
                    replace(bundle, name=name, contract=robot.joints(bundle.contract)),
                    EvaluationCfg(levels, self.cfg.commands, self.cfg.episodes, self.cfg.seconds),
                    threads=num_threads(),
                )
                rows += [{"robot": robot.name} | asdict(row) for row in evaluated.rows]
                self.progress(f"evaluate {name}", (index + 1) / len(self.robots))
            done = {"key": key, "rows": rows}
            write_json(file, sealed(done))
        # As they are read from the file, whether they were walked now or before.
        return json.loads(json.dumps(done["rows"]))


def _read_options(file: Path) -> dict[str, Any]:
    """Return the options in a study's `study.json`."""
    try:
        return dict(json.loads(file.read_text(encoding="utf-8"))["options"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FileError(f"{file} is not what this study writes ({error}); name another --out") from error
