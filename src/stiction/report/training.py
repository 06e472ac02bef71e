"""Pages of trainings: curves and live page of a run, from its files, and the page of an Actuator Net."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from datetime import datetime
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from stiction.core.errors import FileError, StictionError
from stiction.core.files import write_text
from stiction.files.actuator import FILE, ActuatorFit, read_actuator, read_actuator_fit
from stiction.files.plain import read_object
from stiction.files.results import read_metrics
from stiction.joints.net import INPUT_SETS, ActuatorNet
from stiction.report.page import (
    INK,
    Section,
    figure_block,
    file_uri,
    fold,
    labelled,
    legend,
    new_figure,
    paragraph,
    picture,
    render_page,
    save_figure,
    settings_table,
    table,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PANELS: tuple[tuple[str, dict[str, str]], ...] = (
    ("reward a step", {"reward": "reward"}),
    ("tracking error [m/s]", {"walk/tracking_error": "error"}),
    ("speed over commanded", {"walk/forward_ratio": "forward", "walk/backward_ratio": "backward"}),
    ("share of moving steps on one tripod or diagonal", {"walk/tripod_share": "share"}),
    ("falls [1/s]", {"walk/falls": "falls"}),
    ("terrain level", {"terrain/level": "level"}),
    ("step height [m]", {"terrain/step_height": "mean", "terrain/step_height_best_tenth": "best tenth"}),
    (
        "friction over nominal",
        {"friction/high": "largest", "friction/mean": "mean of the robots", "friction/low": "smallest"},
    ),
    ("share of z that z* explains", {"latent/explained": "explained"}),
    ("error of the estimated velocity [m/s]", {"estimator/velocity_error": "error"}),
    ("supervised losses", {"loss/adaptation": "adaptation", "loss/estimator": "estimator"}),
    ("std of the actions", {"action_std": "std"}),
    ("KL divergence of an update", {"kl": "kl"}),
)
"""Axis label -> figures drawn in it. All are of the noisy, pushed, randomised training, not of an evaluation. Figures
that a run lacks (an old one, flat ground) have no panel."""

COLUMNS = 3
"""Panels side by side."""

LIVE_PANELS = 6
"""Panels of the live page, the first that a run has; its last version has all."""


def draw_training(run: Path) -> Path:
    """Draw `curves.png` of the run in folder `run`, the student after the teacher; return its path.

    Raises `StictionError` where the run has no figures yet.
    """
    rows = read_metrics(run / "metrics.jsonl")
    if not rows:
        raise FileError(f"{run / 'metrics.jsonl'} has no iterations yet; expected a run of `stiction train`")
    path = run / "curves.png"
    save_figure(_curves(rows), path)
    return path


def _curves(rows: Sequence[dict[str, Any]], most: int = len(PANELS)) -> Figure:
    """Draw at most so many panels of the figures of all iterations, at least one."""
    recorded = {name for row in rows for name in row}
    panels = [(label, names) for label, names in PANELS if recorded & names.keys()][:most]
    lines = -(-len(panels) // COLUMNS)
    figure, axes = new_figure(lines, COLUMNS, size=(11.0, 2.6 * lines))
    teacher = sum(row["phase"] == "teacher" for row in rows)
    for axis, (label, names) in zip(axes, panels, strict=False):
        for name, short in names.items():
            axis.plot(
                range(1, len(rows) + 1), [row.get(name, float("nan")) for row in rows], label=short, linewidth=1.2
            )
        axis.set(xlabel="iteration", ylabel=label)
        if teacher < len(rows):
            axis.axvline(teacher + 0.5, color=INK, linewidth=0.8, linestyle="--")
            axis.set_xlabel("iteration (student right of the dashed line)")
        axis.set_xlim(0.5, len(rows) + 0.5)
        if len(names) > 1:
            legend(axis)
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    return figure


PAGE_SHARE, PAGE_EVERY = 0.005, 15.0
"""Largest share of the training's time that the live page takes, and shortest time between two versions [s]."""


class LivePage:
    """`report.html` of a run: curves, newest clip and time left; browsers reload it until the training ends."""

    def __init__(self, run: Path, clock: Callable[[], float] = time.monotonic) -> None:
        """Set the folder of the run; the first version is written with the first iteration. `clock`: time [s]."""
        self.run, self.clock = run, clock
        self._due, self._wait = clock(), PAGE_EVERY
        self._failed = False

    def update(self, lines: Sequence[str]) -> None:
        """Write the page where it is due. lines: state of the training, the first one with the time left."""
        if self.clock() < self._due:
            return
        # Before the cost of a version is measured: imported once, and at the end of a training in any case.
        import_module("matplotlib.backends.backend_svg")
        start = self.clock()
        self._write(lines, LIVE_PANELS, self._wait)
        end = self.clock()
        self._wait = max(PAGE_EVERY, (end - start) / PAGE_SHARE)
        self._due = end + self._wait

    def end(self, line: str) -> None:
        """Write the last version, which no browser reloads. line: how the training ended."""
        self._write([line], len(PANELS), refresh=0.0)

    def _write(self, lines: Sequence[str], panels: int, refresh: float) -> None:
        """Write one version, whole or not at all; give up with one warning where that fails."""
        if self._failed:
            return
        try:
            write_text(self.run / "report.html", training_page(self.run, lines, panels, refresh))
        except (StictionError, OSError) as error:
            self._failed = True
            warnings.warn(f"report.html of the run is not written any more: {error}", stacklevel=3)


def training_page(run: Path, lines: Sequence[str], panels: int = len(PANELS), refresh: float = 0.0) -> str:
    """Return the page of a run from its files; lines: state of the training; refresh: time to its next version [s].

    Raises `StictionError` or `OSError` where a file of the run cannot be read.
    """
    header, rows = read_object(run / "config.json", "that of `stiction train`"), read_metrics(run / "metrics.jsonl")
    sections = []
    if rows:
        note = "Figures of the noisy, pushed and randomised training, not of an evaluation."
        sections.append(Section("Curves", (figure_block(_curves(rows, panels), note),)))
    if clip := max((run / "clips").glob("*.webp"), key=lambda path: path.stat().st_mtime, default=None):
        phase, _, iteration = clip.stem.rpartition("_")
        # The only phase of a training has no name.
        part = f" of the {phase}" if header["config"].get("student", {}).get("iterations") else ""
        sections.append(Section("Newest clip", (picture(file_uri(clip), f"After iteration {int(iteration)}{part}."),)))
    sections.append(Section("Settings", (fold("All settings", [settings_table(header["config"])]),)))
    now = f"{datetime.now().astimezone():%Y-%m-%d %H:%M:%S}"
    state = f"As of {now}; written anew about every {refresh:.0f} s while the training runs." if refresh else ""
    title = f"Training {run.resolve().name}"
    return render_page(title, sections, [*lines, state], command=str(header.get("command", "")), refresh=refresh)


SIDES = {
    "motor_side": "motor side: the joint's friction is not in it, and a simulation with this net keeps its own",
    "output_side": "output side: dry and viscous friction are in it, and a simulation with this net drops its own",
}
"""Torque source -> consequence for the simulation."""

BASELINE = (
    "The analytic law beside it is the PD law with the log's own gains, limited, less Coulomb and viscous friction of "
    "each joint. These were fitted by least squares to the training runs alone, with the share λ of the period after "
    "which kd acts, as the mean torque over a period has it: 1 in MuJoCo, which takes kd at the period's end. For that "
    "the law is told the next velocity, which a net has to foresee. Errors are root mean squares over the samples of "
    "whole runs; runs were kept out as a whole, since windows of one run overlap."
)


def write_actuator_page(folder: Path) -> Path:
    """Write `report.html` from the files of `stiction train-actuator` in `folder`; return its path."""
    net, fit = read_actuator(folder / FILE), read_actuator_fit(folder / "fit.npz")
    summary = read_object(folder / "summary.json", "that of train-actuator; run it again")
    page = folder / "report.html"
    caption = f"The end of {next(iter(net.validation))}, which was kept out of the fit; first joint of each group."
    drawn = figure_block(_torques(net, fit), caption)
    sections = [
        Section("Error by joint", (paragraph(BASELINE), joint_table(summary))),
        Section("Error by command", (command_table(summary),)),
        Section("Training", (figure_block(_losses(net, fit), "Mean squared error of torque over limit."),)),
        Section(
            "What was run",
            (
                run_table(net, summary),
                fold("Settings", [settings_table(summary["config"])]),
                paragraph(f"Command: {net.command}"),
            ),
        ),
    ]
    write_text(page, render_page("Actuator Net", sections, lead(summary), command=net.command, figure=drawn))
    return page


def is_worse(summary: dict[str, Any]) -> bool:
    """Return whether the analytic law is the better model of runs that were kept out."""
    errors = summary["rmse"]["validation"]
    return bool(errors["net"] > 1.1 * errors["baseline"])


def lead(summary: dict[str, Any]) -> str:
    """Return the answer: the error on runs that were kept out, beside that of the analytic law."""
    net, law = (summary["rmse"]["validation"][name] for name in ("net", "baseline"))
    if net < 0.9 * law:
        comparison = f"{1 - net / law:.0%} less than the PD law with fitted friction"
    elif is_worse(summary):
        comparison = f"{net / law - 1:.0%} more than the PD law with fitted friction, which is then the better model"
    else:
        comparison = "about that of the PD law with fitted friction: the net has found nothing that the law lacks"
    return (
        f"On runs that it was not fitted to, the net errs by {100 * net:.2f} % of the torque limit, {comparison} "
        f"({100 * law:.2f} %). Inputs: {INPUT_SETS[summary['inputs']]}, H = {summary['history']}."
    )


def joint_table(summary: dict[str, Any]) -> Markup:
    """Return the errors of every joint in N m."""
    header = ["joint", "net, fitted", "net, kept out", "law, fitted", "law, kept out", "f", "B", "λ"]
    names = "net_training", "net_validation", "baseline_training", "baseline_validation", "coulomb", "viscous", "later"
    rows = [[joint, *(f"{errors[name]:.3f}" for name in names)] for joint, errors in summary["joints"].items()]
    return table(header, rows, "Root mean square error in N m; f [N m], B [N m s/rad] and λ of the law.")


def command_table(summary: dict[str, Any]) -> Markup:
    """Return the errors of the runs of each command, over the torque limit."""
    rows = []
    for label, parts in summary["commands"].items():
        cells = [
            f"{100 * parts[part][law]:.2f}" if part in parts else "–"
            for law in ("net", "baseline")
            for part in ("training", "validation")
        ]
        rows.append([label, *cells])
    header = ["command", "net, fitted", "net, kept out", "law, fitted", "law, kept out"]
    return table(header, rows, "Root mean square error, % of the torque limit, all joints.")


def run_table(net: ActuatorNet, summary: dict[str, Any]) -> Markup:
    """Return the table of the net and its logs."""
    rows = [
        ("robot", net.robot),
        ("torque", SIDES[net.torque_source]),
        ("period", f"{net.period:g} s; a simulation that steps by another is refused"),
        ("weights shared by", "; ".join(", ".join(group) for group in net.groups)),
        ("runs fitted", ", ".join(net.training)),
        ("runs kept out", ", ".join(net.validation)),
        ("revision, seed", f"{net.revision}, {net.seed}"),
        ("time", f"{summary['seconds']:.0f} s on {summary['machine']['cpu']}"),
    ]
    return table(["what", "value"], rows)


def _torques(net: ActuatorNet, fit: ActuatorFit) -> Figure:
    """Draw measured, net and law for one joint of each group."""
    figure, axes = new_figure(len(net.groups), 1, size=(9.0, 1.3 * len(net.groups) + 0.8))
    for axis, group in zip(axes, net.groups, strict=True):
        column = net.joint_names.index(group[0])
        for name, style in (("measured", "-"), ("net", "--"), ("baseline", ":")):
            label = "PD law with fitted friction" if name == "baseline" else name
            axis.plot(fit.time, getattr(fit, name)[:, column], style, linewidth=1.1, label=label)
        axis.set_ylabel(f"{group[0]} [N m]")
    axes[-1].set_xlabel("time [s]")
    legend(figure, labelled(axes[0]), loc="outside upper center", ncols=3)
    return figure


def _losses(net: ActuatorNet, fit: ActuatorFit) -> Figure:
    """Draw how the error fell, by group."""
    figure, axes = new_figure(1, 2, size=(9.0, 2.8))
    for axis, name in zip(axes, ("loss_training", "loss_validation"), strict=True):
        for group, values in zip(net.groups, getattr(fit, name), strict=True):
            label = group[0] if len(group) == 1 else f"{group[0]}, …"
            axis.semilogy(np.arange(1, len(values) + 1), values, linewidth=1.2, label=label)
        axis.set(xlabel="epoch", title="runs fitted" if name == "loss_training" else "runs kept out")
    legend(axes[0])
    return figure
