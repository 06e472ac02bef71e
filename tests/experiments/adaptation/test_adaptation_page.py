"""The page on adaptation: every run's numbers, and an answer that follows from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stiction_experiments.adaptation.page import answers, effect_text, report
from stiction_experiments.lab.study import write_report


def make_run(estimated_targets: list[bool], mean: float) -> dict[str, Any]:
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
    wear = {"targets": ["hip", "level"], "estimated": estimated_targets, "window": 10.0}
    wear |= {"determination": [0.4, 0.9], "coverage": [0.95, 0.96], "reach": [0.1, 0.03]}
    return {"latents": {"effects": effects, "rows": []}, "probes": probes, "wear": wear}


def make_summary() -> dict[str, Any]:
    """A run that tells its level, and one that tells nothing."""
    runs = {"some": make_run([False, True], 0.62), "dumb": make_run([False, False], 0.01)}
    runs["twin"] = runs["some"]
    pooled = [effect | {"each": [-0.3, -0.3]} for effect in runs["some"]["latents"]["effects"]]
    probes = [probe | {"each": [0.6, 0.64]} for probe in runs["some"]["probes"]]
    alone = [effect | {"each": [-0.3]} for effect in pooled]
    methods = {
        "direct": {"runs": ["some", "twin"], "effects": pooled, "probes": probes},
        "none": {"runs": ["dumb"], "effects": alone, "probes": []},
    }
    return {"threshold": 0.5, "runs": runs, "methods": methods}


def test_the_answer_has_r_squared_and_the_monitored_targets() -> None:
    """A page must not promise a monitor that there is none of."""
    direct, none = answers(make_summary())
    assert direct.startswith("direct, 2 seeds: R² of the friction from z* 0.62 (0.52 to 0.72) per joint; ")
    assert direct.endswith("; monitored targets: 1 of 2, 1 of 2.")
    assert none.startswith("dumb: R² of the friction from z* 0.01") and none.endswith("monitored targets: 0 of 2.")


def test_the_page_holds_every_table(tmp_path: Path) -> None:
    """Differences with their intervals, shuffled labels beside the true ones, seeds put together, the command."""
    made = {"command": "stiction study adaptation some dumb", "revision": "abc", "machine": {"cpu": "p"}}
    write_report(tmp_path, report(make_summary()), made | {"warnings": []})
    page = (tmp_path / "report.html").read_text()
    for text in (
        "-0.300 (-0.400 to -0.200)",
        "z*, walk, friction shuffled",
        "of another friction level, 20%",
        "direct, over 2 seeds",
        "± 0.030",
        "stiction study adaptation some dumb",
    ):
        assert text in page
    assert {file.name for file in tmp_path.iterdir()} >= {"summary.json", "latents.png", "probes.png"}


def test_the_first_sentence_says_what_another_latent_does() -> None:
    """The title asks what adaptation does; R² of a probe is no answer that a person would give."""
    assert effect_text(make_summary()) == (
        "A policy's speed changes, of the command, by up to 30 % (direct), 30 % (none) when it is given the latent of "
        "a robot with other friction."
    )
