"""How long many trainings take on many nodes, some of which are taken away: python tools/nodes.py --out nodes.csv.

A simulation of what `stiction study friction --train --cluster` does, by what was measured of one training. Every
processor takes the next run; a node that is lost begins anew some time later, and its runs go on, on whichever
processor is free, from their last checkpoint.
"""

from __future__ import annotations

import argparse
import csv
import heapq
import math
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

TRAINING = 650.0
"""Processor time of one `quick` training as it was on soft ground and sliders, 440 iterations: 643 to 654 s
(results/student)."""

CHECKPOINT = TRAINING * 50 / 440
"""Time between two checkpoints, of 50 iterations each [s]."""

START = 20.0
"""Python, torch, the robots and their checkpoint, until the first iteration [s]."""

EVALUATION = 46.0
"""Fourteen cells of sixteen walks of ten seconds, one thread [s]."""

AWAY = 120.0
"""Until there is another node in the place of one that was taken [s]."""

DETECTED = 15.0
"""Until Ray knows that a node is gone [s]."""

PROCESSORS = 2
"""Processors of a node, as on the machine of the measurements."""


@dataclass(frozen=True)
class Row:
    """One number of nodes, and how often they are taken."""

    nodes: int
    """Number of nodes, of `PROCESSORS` each."""
    hours_between_losses: float
    """Mean life of a node [h]; inf: none is taken."""
    trainings: int
    """Number of trainings, each with its evaluation."""
    hours: float
    """Until the last is done [h], median over the seeds."""
    hours_low: float
    """The shortest."""
    hours_high: float
    """The longest."""
    processor_hours: float
    """At work, lost work included [h], median."""
    lost_share: float
    """Share of it that was done again, or was a start [1], median."""


def simulate(nodes: int, life: float, trainings: int, seed: int) -> tuple[float, float, float]:
    """Return the time until all is done, the processor time, and the share of it that was no progress [s, s, 1]."""
    draw = np.random.default_rng(seed)
    whole = TRAINING + EVALUATION
    left = [whole] * trainings
    waiting = list(range(trainings))[::-1]
    free_from = [(0.0, node) for node in range(nodes) for _ in range(PROCESSORS)]
    heapq.heapify(free_from)
    lost_at = [draw.exponential(life) if math.isfinite(life) else math.inf for _ in range(nodes)]
    later: list[tuple[float, int]] = []
    end, busy = 0.0, 0.0
    while waiting or later:
        now, node = heapq.heappop(free_from)
        while later and later[0][0] <= now:
            waiting.append(heapq.heappop(later)[1])
        if not waiting:
            heapq.heappush(free_from, (later[0][0], node))
            continue
        if now >= lost_at[node]:
            back = lost_at[node] + AWAY
            if now >= back:
                lost_at[node] = back + draw.exponential(life)
            heapq.heappush(free_from, (max(now, back), node))
            continue
        run = waiting.pop()
        done_at = now + START + left[run]
        if done_at <= lost_at[node]:
            busy, end = busy + START + left[run], max(end, done_at)
            heapq.heappush(free_from, (done_at, node))
            continue
        worked = max(0.0, lost_at[node] - now - START)
        left[run] -= min(left[run], worked // CHECKPOINT * CHECKPOINT)
        busy += lost_at[node] - now
        heapq.heappush(later, (lost_at[node] + DETECTED, run))
        heapq.heappush(free_from, (lost_at[node], node))
    return end, busy, 1.0 - trainings * whole / busy


def row(nodes: int, hours: float, trainings: int, seeds: int) -> Row:
    """Return what some seeds come to."""
    outcomes = np.array([simulate(nodes, 3600.0 * hours, trainings, seed) for seed in range(seeds)])
    middle, ends = np.median(outcomes, axis=0), outcomes[:, 0] / 3600
    numbers = middle[0] / 3600, ends.min(), ends.max(), middle[1] / 3600, middle[2]
    return Row(nodes, hours, trainings, *(round(float(number), 3) for number in numbers))


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--trainings", type=int, default=100)
    parser.add_argument("--seeds", type=int, default=50)
    asked = parser.parse_args()
    rows = [
        row(nodes, hours, asked.trainings, asked.seeds) for nodes in (1, 8, 64) for hours in (math.inf, 6.0, 1.0, 0.25)
    ]
    with asked.out.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(asdict(rows[0])), lineterminator="\n")
        writer.writeheader()
        writer.writerows(map(asdict, rows))


if __name__ == "__main__":
    main()
