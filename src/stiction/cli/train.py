"""`stiction train`: a teacher and its student, from nothing, resumable."""

from __future__ import annotations

import json
import os
import shlex
import sys
import warnings
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction.core.effects import exclusion
from stiction.core.errors import ConfigurationError, StictionError
from stiction.core.extras import require
from stiction.core.gemm import fast_gemm_note, open_fast_gemm
from stiction.learning.arguments import Train, defaults, parse
from stiction.learning.config import TrainCfg
from stiction.learning.effects import check_effects

if TYPE_CHECKING:
    from stiction.learning.run import RunDirectory


def _friction_from(path: Path, cfg: TrainCfg, arguments: list[str]) -> TrainCfg:
    """Return the configuration with the friction that a `training.json` proposes; refuse flags that say otherwise."""
    from stiction.files.joints import read_training
    from stiction.learning.begin import with_friction

    own = ("--method", "--friction-level", "--friction-law", "--task.friction.")
    given = [flag for word in arguments if (flag := word.partition("=")[0].replace("_", "-")).startswith(own)]
    if given:
        raise ConfigurationError(exclusion("--friction-from", given[0]))
    return with_friction(cfg, read_training(path), path.name)


AGAIN = ("--robot", "--task.robot", "--task.rewards.own")
"""Options that may name a module. With --resume they have to be said again: a module that a file names is not run."""


def _only_resume(arguments: list[str]) -> None:
    """Refuse options beside --resume, with their default values too: the run continues as its config.json says."""
    for word in arguments:
        flag = word.partition("=")[0].replace("_", "-")
        if word.startswith("--") and flag not in ("--resume", "--json", "--view", *AGAIN):
            raise ConfigurationError(exclusion("--resume", flag))


def main(arguments: list[str]) -> int:
    """Run the verb."""
    # Before torch, which is imported after the options are read.
    open_fast_gemm()
    # Only the first of torchrun's processes prints; the others would say everything again.
    if os.environ.get("RANK", "0") != "0":
        return _follow(arguments)
    options = parse(arguments)
    if options.view:
        require("view")
    if options.resume is not None:
        return _resume(options, arguments)
    return _run(options, *_begin(options, arguments))


def _follow(arguments: list[str]) -> int:
    """Train as one of several processes that torchrun has started; the first of them speaks for all."""
    from stiction.learning.phase import Interrupted
    from stiction.learning.ranks import PeerGone, named_ranks
    from stiction.learning.run import RunDirectory, identified_values
    from stiction.learning.runner import train
    from stiction.report.terminal import stop_requests

    try:
        options, ranks = parse(arguments), named_ranks()
        run = RunDirectory(options.out if options.resume is None else options.resume)
        if options.resume is not None and run.finished:
            return 0
        ranks.join(options.config.device)
        ranks.begin()
        cfg = run.config_to_train(options.config.task.rewards.own)
    # The first process fails likewise, and says why.
    except (StictionError, SystemExit, KeyboardInterrupt):
        return 1
    with stop_requests(lambda line: None, "this iteration") as asked:
        try:
            train(cfg, run, identified_values(run.header()), interrupted=asked, ranks=ranks)
        except PeerGone:
            raise
        except Interrupted:
            return asked.status
        except StictionError:
            return 1
    return 0


def _begin(options: Train, arguments: list[str]) -> tuple[RunDirectory, TrainCfg]:
    """Make the folder of a new run."""
    from stiction.learning.begin import begin_run
    from stiction.learning.ranks import named_ranks

    cfg = options.config
    if options.friction_from is not None:
        cfg, base = _friction_from(options.friction_from, cfg, arguments), defaults(arguments)
        # Once more, with the file's friction: nobody typed that, but what was typed has to go with it.
        check_effects(cfg, replace(base, task=replace(base.task, friction=cfg.task.friction)))
    command = shlex.join(["stiction", "train", *arguments])
    return begin_run(options.out, cfg, command, options.joint_map, _say, named_ranks())


def _say(line: str) -> None:
    """Print what the user must know on standard error."""
    print(f"stiction train: {line}", file=sys.stderr)


def _resume(options: Train, arguments: list[str]) -> int:
    """Go on with a run; say so and do nothing where it is finished."""
    from stiction.learning.run import RunDirectory

    assert options.resume is not None
    _only_resume(arguments)
    run, task = RunDirectory(options.resume), options.config.task
    if any(word.partition("=")[0] in AGAIN[:2] for word in arguments):
        run.adopt(task.robot)
    if run.finished:
        run.header()  # a folder with a summary alone is no run
        print(f"stiction train: {run.path} is finished already; next: stiction export {run.path}", file=sys.stderr)
        _report(run, run.summary(), options.json)
        return 0
    cfg = run.config_to_train(task.rewards.own)
    with run.writing():
        run.resume()
    return _run(options, run, cfg)


def _run(options: Train, run: RunDirectory, cfg: TrainCfg) -> int:
    """Train, with progress, clips and an ear for signals; return the exit status."""
    from stiction.cli.progress import training_progress
    from stiction.core.lock import output_folder
    from stiction.evaluation.film import ClipRecorder
    from stiction.learning.phase import Interrupted
    from stiction.learning.ranks import named_ranks
    from stiction.learning.run import identified_values
    from stiction.learning.runner import train
    from stiction.report.terminal import stop_requests

    ranks = named_ranks()
    run.check_processes(ranks.size)
    if cfg.device != "cpu":
        print("stiction train: in its first run MuJoCo Warp compiles its kernels, for minutes", file=sys.stderr)
    with (
        output_folder(run.path),
        training_progress(cfg) as display,
        stop_requests(display.say, "this iteration") as asked,
        _viewer(run.path, display.say) if options.view else nullcontext(),
        warnings.catch_warnings(),
    ):
        # Python's own form is two lines, the second one of our source code.
        warnings.showwarning = lambda message, *_: display.say(f"stiction train: warning: {message}")
        crew = ClipRecorder(run.path, display.say)
        try:
            ranks.join(cfg.device)
            ranks.begin()
            summary = train(cfg, run, identified_values(run.header()), display, asked, crew, ranks)
            # After the training: films wait for it, it does not wait for films.
            crew.finish()
        except Interrupted as stop:
            display.say(f"stiction train: {stop}")
            return asked.status
        finally:
            crew.abandon()
    # Behind the training, so that a refusal is one line; on a GPU the networks are there.
    if cfg.device != "cuda" and (note := fast_gemm_note()):
        _say(note)
    _report(run, summary, options.json)
    return 0


def _viewer(run: Path, say: Callable[[str], None]) -> AbstractContextManager[Any]:
    """Show the run in the browser, in a process beside its training."""
    from stiction.view.companion import watching

    return watching(run, lambda line: say(f"viewer: {line}"))


def _report(run: RunDirectory, summary: dict[str, Any], as_json: bool) -> None:
    """Draw the curves of a finished run and print its summary."""
    from stiction.report.training import draw_training

    with run.writing():
        curves = draw_training(run.path)
    if as_json:
        print(json.dumps(summary))
        return
    student = summary["last"].get("student", summary["last"]["teacher"])
    early = "".join(
        f"{phase} ended early, in iteration {stop['iteration']}: tracking error {stop['walk/tracking_error']:.3f} m/s\n"
        for phase, stop in summary.get("stopped", {}).items()
    )
    print(
        f"{early}policy in {run.path}: tracking error {student['walk/tracking_error']:.3f} m/s, "
        f"tripod share {student['walk/tripod_share']:.0%}, {summary['seconds'] / 60:.1f} min\n"
        f"curves: {curves}\nnext: stiction export {run.path}",
        file=sys.stderr,
    )
