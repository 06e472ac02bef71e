"""Progress of long work, on standard error."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from stiction.rma.config import TrainCfg

PLAIN_EVERY = 50
"""Iterations between lines where standard error is not a terminal."""


@contextmanager
def training_progress(cfg: TrainCfg, quiet: bool) -> Iterator[Callable[[str, int, int, dict[str, float]], None]]:
    """Show both phases with time left and how the robots walk; a line now and then where there is no terminal."""
    console = Console(stderr=True, quiet=quiet)
    columns = (
        TextColumn("{task.description:<8}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=console, disable=quiet or not console.is_terminal) as bar:
        sizes = {"teacher": cfg.teacher.iterations, "student": cfg.student.iterations}
        tasks = {name: bar.add_task(name, total=total, note="") for name, total in sizes.items()}

        def report(phase: str, iteration: int, iterations: int, figures: dict[str, float]) -> None:
            note = (
                f"reward {figures['reward']:.4f}, error {figures['walk/tracking_error']:.3f} m/s, "
                f"tripod {figures['walk/tripod_share']:.0%}, falls {figures['walk/falls']:.3f}/s"
            )
            bar.update(tasks[phase], completed=iteration, note=note)
            if not console.is_terminal and iteration % PLAIN_EVERY == 0:
                console.print(
                    f"{phase} {iteration}/{iterations}: {note}, {figures['seconds']:.1f} s/iteration", soft_wrap=True
                )

        yield report
