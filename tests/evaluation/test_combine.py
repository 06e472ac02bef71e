"""A row made of its episodes is the row measured at once."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from stiction.evaluation.metrics import combine, measure
from stiction.files.velocity import parse_command
from stiction.files.walk import Recording

GROUPS, COMMAND, WEIGHT = np.array([0, 1, 1, 0]), parse_command("vx=0.5"), 98.1


def walks(seed: int = 0, steps: int = 200, robots: int = 3) -> Recording:
    """Return robots that walk at random, none of which falls."""
    rng = np.random.default_rng(seed)
    velocity = rng.normal(0.2, 0.2, (steps, robots, 3))
    return Recording(
        0.02,
        velocity,
        np.cumsum(velocity[..., :2] * 0.02, axis=0),
        rng.random((steps, robots, 4)) < 0.6,
        rng.random((steps, robots)) * 50,
        rng.random((steps, robots)) * 900,
        np.ones((steps, robots), bool),
        rng.random((steps, robots)),
        rng.random((steps, robots)) * 2000,
    )


def test_episodes_combine_to_what_all_of_them_measure() -> None:
    """Episodes measured one by one combine to the metrics of the whole batch."""
    recording = walks()
    whole = asdict(measure(recording, COMMAND, GROUPS, WEIGHT))
    episodes = [measure(recording.of(slice(e, e + 1)), COMMAND, GROUPS, WEIGHT) for e in range(3)]
    for name, value in asdict(combine(episodes)).items():
        assert (value is None) == (whole[name] is None), name
        assert value is None or value == pytest.approx(whole[name], rel=1e-6), name


def test_chatter_that_one_walk_lacks_is_not_known_of_the_row() -> None:
    """A mean over the walks that have it would be of other walks than the rest of the row."""
    seen = measure(walks(), COMMAND, GROUPS, WEIGHT)
    unseen = measure(replace(walks(), square_chatter=None), COMMAND, GROUPS, WEIGHT)
    assert unseen.joint_chatter is None and combine([seen, unseen]).joint_chatter is None
    assert combine([seen, seen]).joint_chatter == pytest.approx(seen.joint_chatter)


def test_a_fall_counts_as_in_a_batch() -> None:
    """A walk that ends with its fall counts with zero speed from then on, and one of two robots has fallen."""
    recording = walks(robots=2)
    recording.upright[80:, 1] = False
    whole = measure(recording, COMMAND, GROUPS, WEIGHT)
    short = recording.of(slice(1, 2))
    ended = Recording(
        *(getattr(short, name) if name == "period" else getattr(short, name)[:81] for name in vars(short))
    )
    first = measure(recording.of(slice(0, 1)), COMMAND, GROUPS, WEIGHT)
    combined = combine([first, measure(ended.extended(200), COMMAND, GROUPS, WEIGHT)])
    assert combined.fall_rate == whole.fall_rate == 0.5
    assert combined.speed_ratio == pytest.approx(whole.speed_ratio)
    assert combined.distance == pytest.approx(whole.distance)
    assert combined.tripod_share == pytest.approx(whole.tripod_share)
