"""Designs of motions in little time."""

from __future__ import annotations

import pytest

from stiction.identification.excite import design, plan


def search_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """Design of few motions: the starters alone, at two pairs of gains, beside two sines and three gains of a sweep."""
    monkeypatch.setattr(design, "GENERATIONS", 0)
    monkeypatch.setattr(design, "POPULATION", len(design.starters()))
    monkeypatch.setattr(design, "FACTORS", (1.0, 0.35))
    monkeypatch.setattr(plan, "SINES", 2)
    monkeypatch.setattr(plan, "SWEEP", (0.5, 1.0, 2.0))
