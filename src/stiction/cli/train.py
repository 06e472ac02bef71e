"""`stiction train`: a teacher and its student, from nothing, resumable."""

from __future__ import annotations

import json
import os
import shlex
import sys
import warnings
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

from stiction.core.effects import exclusion
from stiction.core.errors import ConfigurationError, StictionError
from stiction.core.extras import require
from stiction.core.gemm import fast_gemm_note, open_fast_gemm
from stiction.core.options import ParsedArguments
from stiction.learning.arguments import Train, parse, parse_given
from stiction.learning.config import TrainCfg

if TYPE_CHECKING:
    from stiction.learning.run import RunDirectory


AGAIN = ("resume", "json", "view", "config.task.robot", "config.task.rewards.own")
"""Options that --resume allows. Two may name a module, and are typed again: a module that a file names is not run."""


def main(arguments: list[str]) -> int:
    """Run the verb."""
    # Before torch, which is imported after the options are read.
    open_fast_gemm()
    # Only the first of torchrun's processes prints; the others would say everything again.
    if os.environ.get("RANK", "0") != "0":
        return _follow(arguments)
    options, base, typed = parse_given(arguments)
    if options.view:
        require("view")
    if options.resume is not None:
        return _resume(options, typed)
    return _run(options, *_begin(options, base, typed, shlex.join(["stiction", "train", *arguments])))


def _follow(arguments: list[str]) -> int:
    """Train as one of several processes that torchrun has started; the first of them speaks for all."""
    from stiction.learning.ranks import PeerGone, named_ranks
    from stiction.learning.run import Interrupted, RunDirectory, identified_values
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


def _begin(options: Train, base: TrainCfg, typed: ParsedArguments, command: str) -> tuple[RunDirectory, TrainCfg]:
    """Make the folder of a new run. base: its configuration before the typed options."""
    from stiction.api.training import begin
    from stiction.learning.ranks import named_ranks

    friction = (flag for path, flag in typed.typed.items() if path.startswith("config.task.friction."))
    if options.friction_from is not None and (flag := next(friction, None)):
        raise ConfigurationError(exclusion("--friction-from", flag))
    friction_from, joint_map, ranks = options.friction_from, options.joint_map, named_ranks()
    return begin(options.out, options.config, base, command, friction_from, joint_map, _say, ranks)


def _say(line: str) -> None:
    """Print a note on standard error."""
    print(f"stiction train: {line}", file=sys.stderr)


def _resume(options: Train, typed: ParsedArguments) -> int:
    """Go on with a run; report one that is finished already."""
    from stiction.learning.run import RunDirectory

    assert options.resume is not None
    # Options with their default values too: the run continues as its config.json says.
    for path, flag in typed.typed.items():
        if path not in AGAIN:
            raise ConfigurationError(exclusion("--resume", flag))
    run, task = RunDirectory(options.resume), options.config.task
    if "config.task.robot" in typed.values:
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
    from stiction.learning.boards import open_board
    from stiction.learning.ranks import named_ranks
    from stiction.learning.run import Interrupted, identified_values
    from stiction.learning.runner import train
    from stiction.report.terminal import stop_requests
    from stiction.report.training import LivePage
    from stiction.view.companion import watching

    ranks = named_ranks()
    run.check_processes(ranks.size)
    if cfg.device != "cpu":
        print("stiction train: in its first run MuJoCo Warp compiles its kernels, for minutes", file=sys.stderr)
    with (
        output_folder(run.path),
        training_progress(cfg) as display,
        stop_requests(display.say, "this iteration") as asked,
        watching(run.path, lambda line: display.say(f"viewer: {line}")) if options.view else nullcontext(),
        warnings.catch_warnings(),
        open_board(run.path, cfg) as board,
    ):
        # Python's own form is two lines, the second one of our source code.
        warnings.showwarning = lambda message, *_, **__: display.say(f"stiction train: warning: {message}")
        crew, page = ClipRecorder(run.path, display.say, board.add_clip), LivePage(run.path)

        def show(phase: str, iteration: int, iterations: int, figures: dict[str, float]) -> None:
            display(phase, iteration, iterations, figures)
            crew.poll()
            page.update(display.lines)

        try:
            ranks.join(cfg.device)
            ranks.begin()
            summary = train(cfg, run, identified_values(run.header()), show, asked, crew, ranks, board)
            # After the training: films wait for it, it does not wait for films.
            crew.finish()
        except Interrupted as stop:
            display.say(f"stiction train: {stop}")
            return asked.status
        finally:
            crew.abandon()
            page.end("Finished." if run.finished else f"Stopped; `stiction train --resume {run.path}` goes on with it.")
    # Behind the training, so that a refusal is one line; on a GPU the networks are there.
    if cfg.device != "cuda" and (note := fast_gemm_note()):
        _say(note)
    _report(run, summary, options.json)
    return 0


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
        f"{summary['seconds'] / 60:.1f} min\n"
        f"curves: {curves}, {run.path / 'report.html'}\nnext: stiction export {run.path}",
        file=sys.stderr,
    )
