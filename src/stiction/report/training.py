"""The curves of a training run, drawn from its metrics.jsonl."""

from __future__ import annotations

from pathlib import Path

from stiction.formats.errors import StictionError
from stiction.formats.metrics import read_metrics
from stiction.report.page import INK, legend, new_figure

PANELS: tuple[tuple[str, dict[str, str]], ...] = (
    ("reward a step", {"reward": "reward"}),
    ("tracking error [m/s]", {"walk/tracking_error": "error"}),
    ("speed over commanded", {"walk/forward_ratio": "forward", "walk/backward_ratio": "backward"}),
    ("tripod share while moving", {"walk/tripod_share": "tripod"}),
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
"""Axis label -> figures drawn in it. All are of the noisy, pushed, randomised training, not of an evaluation. What a
run does not have (an old one, flat ground) has no panel."""

COLUMNS = 3
"""Panels side by side."""


def draw_training(run: Path) -> Path:
    """Draw `curves.png` of the run in folder `run`, the student after the teacher; return its path.

    Raises `StictionError` where the run has no figures yet.
    """
    rows = read_metrics(run / "metrics.jsonl")
    if not rows:
        raise StictionError(f"{run / 'metrics.jsonl'} has no iterations yet; expected a run of `stiction train`")
    recorded = {name for row in rows for name in row}
    panels = [(label, names) for label, names in PANELS if recorded & names.keys()]
    lines = -(-len(panels) // COLUMNS)
    figure, axes = new_figure(lines, COLUMNS, size=(11.0, 2.6 * lines))
    teacher = sum(row["phase"] == "teacher" for row in rows)
    for axis, (label, names) in zip(axes, panels, strict=False):
        for name, short in names.items():
            axis.plot(
                range(1, len(rows) + 1), [row.get(name, float("nan")) for row in rows], label=short, linewidth=1.2
            )
        axis.axvline(teacher + 0.5, color=INK, linewidth=0.8, linestyle="--")
        axis.set_xlabel("iteration (student right of the dashed line)")
        axis.set_ylabel(label)
        axis.set_xlim(0.5, len(rows) + 0.5)
        if len(names) > 1:
            legend(axis)
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    path = run / "curves.png"
    figure.savefig(path, dpi=120, facecolor="white")
    return path
