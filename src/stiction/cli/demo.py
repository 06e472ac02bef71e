"""`stiction demo`: the whole line on small real input, and one page that explains it."""

from __future__ import annotations

import contextlib
import io
import os
import shlex
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from stiction.core.effects import excludes, needs
from stiction.core.files import write_text
from stiction.core.options import read_options

if TYPE_CHECKING:
    from stiction.deploy.check import BundleCheck
    from stiction.evaluation.evaluate import EvaluationCfg
    from stiction.files.results import ResultRow
    from stiction.report.demo import DemoJoint

COMMANDS = ("vx=0.5", "vx=-0.5", "vy=0.3", "wz=0.5")
"""Commands that the policies are given, four of the fifteen to be followed; the first is the one of the clips."""

METHODS = ("none", "direct", "deception")
"""Training methods that the demo compares."""

ROBOT, LEVEL = "saturn_lite", 0.2
"""Robot and nominal friction level of the demo's policies."""

EMPS = Path("emps") / "DATA_EMPS.mat"
"""The measured record, within the folder that STICTION_DATA names."""

EMPS_OPTIONS = (
    *("--columns", "time=t", "position=qm", "target=qg", "torque=vir", "--torque-scale", "35.15065"),
    *("--kp", "1370750", "--kd", "8557.5", "--set", "velocity_delay=0.001", "--axis", "linear", "--joint", "drive"),
    *("--torque-source", "motor_side", "--test-condition", "loaded"),
)
"""Columns, gains and set-up of the record, as in docs/identification.md. Its command is in volts, 35.15 N each. Its
loop is a position gain of 160.18/s around a speed gain of 243.45 V s/m: a PD controller with kd = 243.45 * 35.15 N s/m
and kp = 160.18/s * kd, whose speed is one sample late."""


@dataclass(frozen=True)
class DemoCfg:
    """Run the whole line: identify, check, evaluate, render, explain."""

    out: Path = Path("stiction-demo")
    """Directory for everything that is made; the page is report.html in it."""
    train: bool = False
    """Train policies in place of the shipped ones: three runs, each 12 to 25 minutes of one core. One that was
    interrupted goes on where it was."""
    preset: Literal["quick", "full"] = field(default="quick", metadata=needs("--train"))
    """Preset of `stiction train`, with --train."""
    bundles: tuple[Path, ...] = field(default=(), metadata=excludes("--train"))
    """Bundles to show in place of those that come with the package, directories or names."""
    episodes: int = 8
    """Episodes per policy, level and command."""
    seconds: float = 12.0
    """Length of an episode [s]."""
    loop: bool = field(default=False, metadata=excludes("--train", "--preset", "--bundles", "--episodes", "--seconds"))
    """The loop of a robot in place of the page: motions on a virtual robot's bench, identify, deploy a policy, identify
    its walk; beside what the robot really has. Some four minutes, in real time."""
    overwrite: bool = False
    """Write over results of other settings in --out."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> None:
    """Run the demo and print where its page is."""
    cfg = read_options(DemoCfg, arguments, "stiction demo", DESCRIPTION)
    from stiction.core.extras import require
    from stiction.files.results import summary_text
    from stiction.files.settings import results_folder
    from stiction.report.demo import RESULTS

    if cfg.train:
        require("train")
    if cfg.loop:
        _loop(cfg)
        return
    with results_folder(cfg.out, "demo", cfg, RESULTS, {"bundles": cfg.bundles}):
        page, summary, warnings = _run(cfg, arguments)
    for text in warnings:
        _say(f"note: {text}")
    if cfg.json:
        print(summary_text(summary), end="")
    else:
        print(f"open this page: {page.resolve()}")


def _run(cfg: DemoCfg, arguments: list[str]) -> tuple[Path, dict[str, Any], list[str]]:
    """Run the whole line; return the page, the summary and what was left out."""
    from stiction.deploy.check import check_bundle
    from stiction.files.bundle import find_bundle

    _settings(cfg)  # Refused before any work is done.
    start = time.perf_counter()
    warnings: list[str] = []
    bundles = [find_bundle(path) for path in cfg.bundles]
    checks = [check_bundle(path) for path in bundles]
    joints = [_identify_example(cfg.out), *_identify_record(cfg.out, warnings)]
    if not bundles:
        bundles = _find_policies(cfg, warnings)
        checks = [check_bundle(path) for path in bundles]
    page, summary = _evaluate(cfg, arguments, joints, bundles, checks, warnings)
    summary |= {"report": str(page), "warnings": warnings, "total_seconds": time.perf_counter() - start}
    return page, summary, warnings


def _loop(cfg: DemoCfg) -> None:
    """Run the loop on a virtual robot and print what agrees."""
    from stiction.cli.loop import run_loop, shares, show
    from stiction.files.settings import results_folder

    with results_folder(cfg.out, "demo --loop", cfg, ("loop.json",)):
        rows = run_loop(cfg.out)
    if cfg.json:
        print((cfg.out / "loop.json").read_text(encoding="utf-8"), end="")
        return
    show(rows)
    for name, (held, total) in shares(rows).items():
        print(f"{name.split('_')[0]}: {held} of {total} intervals of 95 % hold what the joint really has")


def _say(text: str) -> None:
    """Tell the user on standard error what is going on."""
    print(text, file=sys.stderr)


def _identify_example(out: Path) -> DemoJoint:
    """Identify the paper's shank motor from a simulated log, written to a file first."""
    from stiction.files.log import write_log
    from stiction.identification.example import SATURN_LITE, example_log

    log = out / "example" / "shank.csv"
    write_log(log, example_log(SATURN_LITE))
    title = "the paper's shank motor, simulated with the noise of real sensors"
    return _identify(title, [str(log), "--out", str(log.parent)])


def _identify_record(out: Path, warnings: list[str]) -> list[DemoJoint]:
    """Identify the measured record where it is at hand; say so where STICTION_DATA names a folder without it."""
    folder = os.environ.get("STICTION_DATA")
    if not folder:
        return []
    record = Path(folder) / EMPS
    if not record.is_file():
        warnings.append(f"The measured record of a linear drive was left out: {folder} has no {EMPS}.")
        return []
    title = "a linear drive, measured (EMPS, nonlinearbenchmark.org)"
    return [_identify(title, [str(record), *EMPS_OPTIONS, "--out", str(out / "emps")])]


def _identify(title: str, arguments: list[str]) -> DemoJoint:
    """Run `stiction identify` and take from its files what the page shows."""
    from stiction.cli import identify
    from stiction.files.bam import load_joints
    from stiction.files.joints import read_fit
    from stiction.report.demo import DemoJoint
    from stiction.report.identification import joint_sections

    command = shlex.join(["stiction", "identify", *arguments])
    _say(command)
    with contextlib.redirect_stdout(io.StringIO()):
        identify.main([*arguments, "--overwrite"])
    folder = Path(arguments[arguments.index("--out") + 1])
    (name, record), *_ = load_joints(folder / "joints.json").joints.items()
    summary, cloud, *_ = joint_sections(name, record, read_fit(folder / "fit.npz", name))
    return DemoJoint(title, command, name, record, (summary.blocks[0], *cloud.blocks))


def _find_policies(cfg: DemoCfg, warnings: list[str]) -> list[Path]:
    """Return the bundles to show: those trained now, or the shipped ones."""
    from stiction.files.bundle import shipped_bundles

    names = [f"{ROBOT}-flat-{method}-{LEVEL:g}" for method in METHODS]
    if cfg.train:
        return [_train(cfg, method, cfg.out / "policies" / name) for method, name in zip(METHODS, names, strict=True)]
    shipped = shipped_bundles()
    if missing := [name for name in names if name not in shipped]:
        warnings.append(f"This installation comes without the policies {', '.join(missing)}; --train trains them.")
    return [shipped[name] for name in names if name in shipped]


def _train(cfg: DemoCfg, method: str, bundle: Path) -> Path:
    """Train one policy, or go on with it, and export it; return its bundle."""
    if bundle.exists():
        return bundle
    from stiction.cli import train
    from stiction.evaluation.export import export_run

    run = cfg.out / "runs" / method
    # config.json is what makes a folder a run.
    started = ["--resume", str(run)] if (run / "config.json").exists() else []
    fresh = ["--preset", cfg.preset, "--robot", ROBOT, "--method", method, "--friction-level", f"{LEVEL:g}"]
    arguments = started or [*fresh, "--out", str(run)]
    _say(shlex.join(["stiction", "train", *arguments]))
    with contextlib.redirect_stdout(sys.stderr):
        train.main(arguments)
    export_run(run, bundle)
    return bundle


def _evaluate(
    cfg: DemoCfg,
    arguments: Sequence[str],
    joints: list[DemoJoint],
    bundles: list[Path],
    checks: list[BundleCheck],
    warnings: list[str],
) -> tuple[Path, dict[str, Any]]:
    """Evaluate and render the checked policies; write every file; return the page's path and the summary."""
    from stiction.report.demo import policy_names, render_demo
    from stiction.report.evaluation import write_evaluation

    # The most that any of them met in training.
    level = max((round(check.bundle.contract.friction_range[1], 6) for check in checks), default=0.0) or LEVEL
    rows: list[ResultRow] = []
    summary: dict[str, Any] = {
        "command": shlex.join(["stiction", "demo", *arguments]),
        "joints": {joint.name: joint.record.to_dict() for joint in joints},
    }
    if checks:
        rows, evaluated = _walk(cfg, checks, level)
        summary |= evaluated
        write_evaluation(cfg.out / "evaluation", rows, summary)
    names = policy_names([check.bundle for check in checks])
    clip = _render(cfg, bundles, names, level, warnings)
    page = cfg.out / "report.html"
    write_text(
        page,
        render_demo(joints, dict(zip(names, checks, strict=True)), rows, summary, (COMMANDS[0], level, clip), warnings),
    )
    return page, summary


def _settings(cfg: DemoCfg, levels: tuple[float, ...] = (0.0,)) -> EvaluationCfg:
    """Return how the policies are evaluated; raise `StictionError` for episodes that none can walk."""
    from stiction.evaluation.evaluate import EvaluationCfg

    return EvaluationCfg(levels, COMMANDS, episodes=cfg.episodes, seconds=cfg.seconds)


def _walk(cfg: DemoCfg, checks: list[BundleCheck], level: float) -> tuple[list[ResultRow], dict[str, Any]]:
    """Evaluate the policies from no friction to half more than a level."""
    from stiction.core.provenance import num_threads
    from stiction.core.records import make_folder
    from stiction.evaluation.grid import GridCfg
    from stiction.evaluation.summary import evaluate_all
    from stiction.joints.friction import MAX_LEVEL
    from stiction.report.terminal import work_progress

    levels = tuple(dict.fromkeys(min(round(share * level, 6), MAX_LEVEL) for share in (0.0, 0.5, 1.0, 1.5)))
    make_folder(cfg.out / "evaluation")
    _say("evaluating policies over friction levels")
    with work_progress() as progress:
        bundles = [check.bundle for check in checks]
        grid, out = GridCfg(_settings(cfg, levels)), cfg.out / "evaluation"
        return evaluate_all(bundles, grid, out, jobs=num_threads(), progress=progress)


def _render(
    cfg: DemoCfg, bundles: Sequence[Path], names: Sequence[str], level: float, warnings: list[str]
) -> Path | None:
    """Render the first and the last policy, or those of --bundles, in one scene; say so where OpenGL is missing."""
    from stiction.evaluation.clip import ClipError, record_side_by_side
    from stiction.report.page import COLORS

    if not bundles:
        return None
    _say("rendering them side by side")
    chosen = range(len(bundles)) if cfg.bundles else sorted({0, len(bundles) - 1})
    films, called = [bundles[number] for number in chosen], [names[number] for number in chosen]
    colors = [COLORS[number % len(COLORS)] for number in chosen]
    try:
        return record_side_by_side(films, called, colors, level, COMMANDS[0], cfg.out / "side-by-side.webp")
    except ClipError as error:
        warnings.append(f"{error}.")
        return None


DESCRIPTION = """Identify a joint from a log, say whether its friction matters, check and evaluate policies over
friction levels, render them side by side, and write one page that explains it all.

Examples:
  stiction demo
  stiction demo --bundles runs/mine/bundle --out my-demo
  stiction demo --loop"""
