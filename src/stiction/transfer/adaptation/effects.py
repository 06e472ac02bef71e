"""What becomes of a policy whose latent is frozen or taken from another robot, level by level."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from stiction.transfer.adaptation.ridge import mean_interval
from stiction.transfer.evaluate import Evaluation, EvaluationCfg
from stiction.transfer.latents import LATENTS
from stiction.transfer.run_evaluation import walk_run
from stiction.transfer.statistics import t_interval

FIGURES = ("speed_ratio", "tracking_error")
"""What is compared: does the robot get less far, does it follow less well?"""


def latent_effects(
    run: Path, cfg: EvaluationCfg, threads: int, progress: Callable[[float], None] = lambda share: None
) -> dict[str, Any]:
    """Evaluate a run's student on every kind of latent; return `rows` of results.csv and `effects`.

    An effect is the difference to the walk on its own latent at one friction level, of the means over commands. Episode
    e has the same initial state and noise in both walks, so the difference is taken episode by episode; its interval
    is a bootstrap over episodes, for this policy and no other.
    """
    walks: dict[str, Evaluation] = {}
    for number, latent in enumerate(LATENTS):
        walks[latent] = walk_run(run, "student", cfg, latent, threads)
        progress((number + 1) / len(LATENTS))
    effects = []
    for latent in LATENTS[1:]:
        for index, level in enumerate(cfg.friction_levels):
            for figure in FIGURES:
                own, other = (per_episode(walks[name], cfg, index, figure) for name in ("own", latent))
                effects.append(
                    {
                        "latent": latent,
                        "level": level,
                        "figure": figure,
                        "own": float(own.mean()),
                        "value": float(other.mean()),
                        "difference": float((other - own).mean()),
                        "interval95": list(mean_interval(other - own)),
                    }
                )
    return {"rows": [asdict(row) for walk in walks.values() for row in walk.rows], "effects": effects}


def per_episode(walk: Evaluation, cfg: EvaluationCfg, level: int, figure: str) -> np.ndarray:
    """Return a figure of each episode at the level number `level`, means over the commands, shape (episodes,)."""
    count = len(cfg.commands)
    rows = walk.episodes[level * count : (level + 1) * count]
    return np.mean([[getattr(episode, figure) for episode in row] for row in rows], axis=0)


def over_seeds(runs: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the effects of runs of one method, means over their seeds with t-intervals (null for a single seed).

    `runs`: what `latent_effects` returned for each, over the same levels.
    """
    pooled = []
    for same in zip(*(run["effects"] for run in runs), strict=True):
        values = {name: np.array([effect[name] for effect in same]) for name in ("own", "value", "difference")}
        interval = t_interval(values["difference"].tolist())
        pooled.append(
            {name: same[0][name] for name in ("latent", "level", "figure")}
            | {name: float(value.mean()) for name, value in values.items()}
            | {"interval95": None if interval is None else list(interval), "seeds": len(same)}
            | {"each": values["difference"].tolist()}
        )
    return pooled
