"""Evaluates several bundles under the same conditions, and says what was run on what."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

from stiction.formats.bundle import Bundle
from stiction.formats.errors import StictionError
from stiction.formats.reproducibility import provenance
from stiction.formats.results import ResultRow
from stiction.transfer.evaluate import EvaluationCfg, evaluate_bundle

Progress = Callable[[str, float], None]
"""Called with the name of the bundle and the share of it that is done."""


def evaluate_all(
    bundles: Sequence[Bundle],
    cfg: EvaluationCfg,
    robot: str | None,
    threads: int,
    progress: Progress = lambda name, share: None,
) -> tuple[list[ResultRow], dict[str, Any]]:
    """Evaluate bundles one after the other; return the rows of all and the summary.

    Raises:
        StictionError: two bundles have the same name, or one does not fit its robot.

    """
    check_names([bundle.name for bundle in bundles])
    rows: list[ResultRow] = []
    details: list[dict[str, Any]] = []
    policies: dict[str, Any] = {}
    start = time.perf_counter()
    for bundle in bundles:
        evaluation = evaluate_bundle(bundle, cfg, robot, threads, partial(progress, bundle.name))
        rows += evaluation.rows
        details += evaluation.details()
        policies[bundle.name] = describe(bundle) | {"blown_up": evaluation.blown_up}
    summary = {
        "evaluation": asdict(cfg),
        "conditions": cfg.conditions,
        "robot": robot,
        "seconds": time.perf_counter() - start,
        **provenance(),
        "policies": policies,
        "rows": details,
    }
    return rows, summary


def check_names(names: Sequence[str], kind: str = "bundles") -> None:
    """Raise `StictionError` where two of a kind have the same name."""
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise StictionError(
            f"two {kind} are called {twice[0]!r}; rename one directory, results tell them apart by name"
        )


def describe(bundle: Bundle) -> dict[str, Any]:
    """Return what identifies a policy: its digest, and how it was made."""
    contract = bundle.contract
    return {
        "digest": bundle.digest,
        "robot": contract.robot,
        "method": contract.method,
        "friction_law": contract.friction_law,
        "friction_level": contract.friction_level,
        "friction_range": contract.friction_range,
        "joints_file": contract.joints_file,
        "actuator": contract.actuator,
        "seed": contract.seed,
        "revision": contract.revision,
        "command": contract.command,
    }
