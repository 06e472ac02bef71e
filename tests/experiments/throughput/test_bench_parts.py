"""Where the time goes: every second is counted once, and the ratios are those of paired blocks."""

from __future__ import annotations

import pytest

pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to measure training")
pytest.importorskip("rsl_rl", reason="the package rsl_rl, of the extra 'train', is needed to measure training")

from stiction_experiments.throughput.measure import Meter, parts_summary

OWN = {"bare": 7.0, "step": 0.5, "act": 0.25, "store": 0.125, "returns": 0.0625, "supervise": 2.0, "update": 4.0}
"""Part -> its own seconds."""

WITHIN = {"step": ("bare",), "update": ("supervise",)}
"""Part -> the parts that it calls."""


class Training:
    """An iteration whose parts take known times on a clock of its own."""

    def __init__(self) -> None:
        """Make a method of every part, and the iteration: two steps and an update."""
        self.now = 0.0
        for name in OWN:
            setattr(self, name, lambda name=name: self._take(name))
        self.iterate = self._iterate

    def _take(self, name: str) -> None:
        self.now += OWN[name]
        for part in WITHIN.get(name, ()):
            getattr(self, part)()

    def _iterate(self) -> None:
        for name in ("act", "step", "store", "act", "step", "store", "returns", "update"):
            getattr(self, name)()
        self.now += 0.03125


def test_every_second_is_counted_once() -> None:
    """Physics lies within the task's step and the supervised pass within the update: neither may count twice."""
    training = Training()
    meter = Meter(lambda: training.now)
    for name in (*OWN, "iterate"):
        meter.watch(training, name, name)
    for _ in range(2):
        training.iterate()
        parts = meter.take()
        assert parts == {
            "physics": 14.0,
            "task": 1.0,
            "inference": 0.8125,
            "ppo": 4.0,
            "supervised": 2.0,
            "other": 0.03125,
            "iteration": 21.84375,
        }
        assert sum(parts.values()) == 2 * parts["iteration"]


def test_ratios_are_those_of_paired_blocks() -> None:
    """Two blocks, the second on a machine of half the speed: ratios of medians would be other ones."""
    slow = {"physics": [6.0, 12.0], "task": [2.0, 4.0], "iteration": [12.0, 24.0]}
    fast = {"physics": [3.0, 4.5], "task": [1.0, 1.5], "iteration": [6.0, 9.0]}
    summary = parts_summary({"slow": slow, "fast": fast})
    assert summary["slow"]["rollout_over_bare"] == 0.75 and summary["slow"]["iteration_over_bare"] == 0.5
    assert summary["slow"]["speedup"] == 1.0
    assert summary["fast"]["speedup"] == pytest.approx((2.0 + 24.0 / 9.0) / 2)
    assert summary["fast"]["physics"] == 3.75
