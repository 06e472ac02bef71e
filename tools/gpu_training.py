"""Say how long a training took to follow.

    python tools/gpu_training.py RUN

One JSON object: iterations, their seconds without what came before the first, the median of control steps a second, and
`seconds_within`, after which the robots followed within 0.85 to 1.15 both forward and backward for `HELD` iterations on
end, with their exploration noise; null where they never did.
"""

from __future__ import annotations

import argparse
import json
import statistics
from pathlib import Path

from stiction.learning.run import RunDirectory

LOW, HIGH = 0.85, 1.15
HELD = 10
RATIOS = ("walk/forward_ratio", "walk/backward_ratio")


def figures(rows: list[dict[str, float]]) -> dict[str, float | None]:
    """Return the figures of a run's rows, as of `RunDirectory.rows`."""
    held, total, within = 0, 0.0, None
    for row in rows:
        total += row["seconds"]
        held = held + 1 if all(LOW <= row[name] <= HIGH for name in RATIOS) else 0
        if held == HELD and within is None:
            within = total
    return {
        "iterations": len(rows),
        "seconds": round(total, 1),
        "env_steps_per_second": round(statistics.median(row["env_steps_per_second"] for row in rows)),
        "seconds_within": None if within is None else round(within, 1),
    }


def main() -> None:
    """Print the figures of a run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("run", type=Path, help="folder of the training")
    print(json.dumps(figures(RunDirectory(parser.parse_args().run).rows())))


if __name__ == "__main__":
    main()
