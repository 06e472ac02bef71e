"""The page on adaptation: every run's numbers, and an answer that follows from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stiction.report.adaptation import lead, write_adaptation
from stiction.report.adaptation_figures import draw_effects, draw_probes


def make_run(told: list[bool], mean: float) -> dict[str, Any]:
    """One run's part of a summary."""
    effects = [
        {
            "latent": "swapped",
            "level": 0.2,
            "figure": figure,
            "own": 0.8,
            "value": 0.5,
            "difference": -0.3,
            "interval95": [-0.4, -0.2],
        }
        for figure in ("speed_ratio", "tracking_error")
    ]
    probes = [
        {
            "input": name,
            "row": "walk",
            "per": per,
            "shuffled": mixed,
            "mean": mean,
            "interval95": [mean - 0.1, mean + 0.1],
        }
        for name, mixed in (("latent", False), ("moments", False), ("latent", True))
        for per in ("joint", "robot")
    ]
    wear = {"targets": ["hip", "level"], "told": told, "window": 10.0}
    wear |= {"determination": [0.4, 0.9], "coverage": [0.95, 0.96], "reach": [0.1, 0.03]}
    return {"latents": {"effects": effects, "rows": []}, "probes": probes, "wear": wear}


def make_summary() -> dict[str, Any]:
    """A run that tells its level, and one that tells nothing."""
    runs = {"some": make_run([False, True], 0.62), "dumb": make_run([False, False], 0.01)}
    pooled = [effect | {"each": [-0.3, -0.3]} for effect in runs["some"]["latents"]["effects"]]
    probes = [probe | {"each": [0.6, 0.64]} for probe in runs["some"]["probes"]]
    methods = {"direct": {"effects": pooled, "probes": probes}}
    return {"command": "stiction study adaptation some dumb", "revision": "abc", "threshold": 0.5} | {
        "runs": runs,
        "methods": methods,
    }


def test_the_answer_says_what_is_told_and_what_is_not() -> None:
    """A page must not promise a monitor that there is none of."""
    text = lead(make_summary())
    assert "some: z* tells each joint's friction with R² 0.62 (0.52 to 0.72)" in text
    assert "a wear monitor tells the robot's level. dumb" in text
    assert text.endswith("; no wear is told.")
    summary = make_summary()
    summary["runs"]["some"]["wear"]["told"] = [True, True]
    assert "a wear monitor tells the friction of 1 of 1 joints and the robot's level" in lead(summary)


def test_the_page_holds_every_table(tmp_path: Path) -> None:
    """Differences with their intervals, shuffled labels beside the true ones, seeds put together, the command."""
    page = write_adaptation(tmp_path, [], make_summary()).read_text()
    for text in (
        "-0.300 (-0.400 to -0.200)",
        "z*, walk, friction shuffled",
        "of another friction level, 20%",
        "over 2 seeds, t-intervals",
        "± 0.030",
        "stiction study adaptation some dumb",
    ):
        assert text in page
    assert {file.name for file in tmp_path.iterdir()} >= {"results.csv", "summary.json", "latents.png", "probes.png"}


def test_the_figures_show_every_seed_and_no_shuffled_probe() -> None:
    """Two inputs, two targets, two seeds: four rows of dots, each with a bar; one change of speed, each seed a line."""
    methods = make_summary()["methods"]
    inputs = {"latent": "z*", "moments": "moments"}
    figure = draw_probes(methods, inputs, {"joint": "each joint", "robot": "a robot"})
    dots = [line for axis in figure.axes for line in axis.lines if line.get_marker() == "o"]
    bars = [line for axis in figure.axes for line in axis.lines if line.get_linewidth() == 3]
    assert [list(line.get_xdata()) for line in dots] == [[0.6, 0.64]] * 4
    assert [list(line.get_xdata()) for line in bars] == [[0.52, 0.72]] * 4
    lines = draw_effects(methods, {"swapped": "swapped"}).axes[0].lines
    assert [list(line.get_ydata()) for line in lines[:3]] == [[-0.3], [-0.3], [-0.3]]
