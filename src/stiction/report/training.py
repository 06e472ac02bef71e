"""The curves of a training run, drawn from its metrics.jsonl."""

from __future__ import annotations

from pathlib import Path

from stiction.formats.errors import StictionError
from stiction.formats.metrics import read_metrics
from stiction.report.page import legend, new_figure

PANELS = (
    ("reward a step", {"reward": "reward"}),
    ("tracking error [m/s]", {"walk/tracking_error": "error"}),
    ("speed over commanded", {"walk/forward_ratio": "forward", "walk/backward_ratio": "backward"}),
    ("tripod share while moving", {"walk/tripod_share": "tripod"}),
    ("falls [1/s]", {"walk/falls": "falls"}),
    ("supervised losses", {"loss/adaptation": "adaptation", "loss/estimator": "estimator"}),
)
"""Axis label -> figures drawn in it. All are of the noisy, pushed, randomised training, not of an evaluation."""


def draw_training(run: Path) -> Path:
    """Draw `curves.png` of the run in folder `run`, the student after the teacher; return its path.

    Raises `StictionError` where the run has no figures yet.
    """
    rows = read_metrics(run / "metrics.jsonl")
    if not rows:
        raise StictionError(f"{run / 'metrics.jsonl'} has no iterations yet; expected a run of `stiction train`")
    figure, axes = new_figure(2, 3, size=(11.0, 5.2))
    teacher = sum(row["phase"] == "teacher" for row in rows)
    for axis, (label, names) in zip(axes, PANELS, strict=True):
        for name, short in names.items():
            axis.plot(
                range(1, len(rows) + 1), [row.get(name, float("nan")) for row in rows], label=short, linewidth=1.2
            )
        axis.axvline(teacher + 0.5, color="#7d8590", linewidth=0.8, linestyle="--")
        axis.set_xlabel("iteration (student right of the dashed line)")
        axis.set_ylabel(label)
        if len(names) > 1:
            legend(axis)
    path = run / "curves.png"
    figure.savefig(path, dpi=120, facecolor="white")
    return path
