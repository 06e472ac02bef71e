"""The rows of the torque equation: payloads by hand, runs that stack, blocks that keep to their run."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from stiction.identification.prepare import Prepared, Rows, make_rows
from stiction.identification.setup import Payload


def prepared(
    count: int = 4, step: float = 0.1, used: tuple[int, ...] | None = None, **signals: list[float]
) -> Prepared:
    """Return a run of plain numbers; a signal that is not given counts 0, 1, 2, and nothing pushes."""
    names = ("position", "velocity", "acceleration", "direction", "torque", "outside")
    signals.setdefault("outside", [0.0] * count)
    arrays = {name: np.asarray(signals.get(name, np.arange(count, dtype=float))) for name in names}
    return Prepared(step=step, cutoff=10.0, threshold=0.5, used=np.array(used or range(count)), **arrays)


def test_a_payload_asks_for_weight_and_inertia() -> None:
    """2 kg at 0.5 m that hangs straight down at 0.3 rad: m g r = 9.81 N m, m r² = 0.5 kg m².

    At 0.3 + π/6 rad the weight is 9.81 / 2 = 4.905 N m, 90° from hanging all of it, and 4 rad/s² ask for 2 N m more.
    """
    run = prepared(
        position=[0.3, 0.3 + np.pi / 6, 0.3 + np.pi / 2, 0.3 - np.pi / 2],
        acceleration=[4.0, 0.0, 4.0, -4.0],
        outside=[0.0, 1.0, 0.0, 2.0],
    )
    rows = make_rows([run], [Payload(2.0, 0.5, 0.3)])
    np.testing.assert_allclose(rows.payload, [2.0, 3.905, 11.81, -13.81], atol=1e-12)
    np.testing.assert_allclose(rows.load, [0.0, 3.905, 9.81, -11.81], atol=1e-12)


def test_what_is_known_stands_over_the_declared_strength() -> None:
    """Torque in units of a motor that gives half: 3 N m from outside are 6 of its own."""
    run = prepared(position=[np.pi / 2] * 4, acceleration=[0.0] * 4, outside=[0.0, 0.0, 3.0, 3.0])
    rows = make_rows([run], [Payload(1.0, 0.1, 0.0)], 0.5)
    np.testing.assert_allclose(rows.payload, [1.962, 1.962, -4.038, -4.038])
    np.testing.assert_allclose(rows.load, rows.payload)
    np.testing.assert_array_equal(rows.torque, [0.0, 1.0, -1.0, 0.0])


def test_runs_stack_one_after_the_other_with_their_own_payloads() -> None:
    """Four samples of 0.1 s, then three of 0.2 s of which two count: those begin at 0.4 s, with their own weight."""
    first = prepared(used=(1, 3), position=[0.0, 0.1, 0.2, 0.3])
    second = replace(prepared(3, 0.2, (0, 2), position=[np.pi / 2, 0.0, -np.pi / 2]), threshold=0.7)
    rows = make_rows([first, second], [None, Payload(1.0, 0.1, 0.0)])
    np.testing.assert_allclose(rows.time, [0.1, 0.3, 0.4, 0.8])
    np.testing.assert_allclose(rows.position, [0.1, 0.3, np.pi / 2, -np.pi / 2])
    np.testing.assert_array_equal(rows.run, [0, 0, 1, 1])
    # m g r = 0.981 N m, m r² = 0.01 kg m²; the second run's accelerations are 0 and 2 rad/s².
    np.testing.assert_allclose(rows.payload, [0.0, 0.0, 0.981, -0.981 + 0.02])
    assert rows.slowest == 0.7 and len(rows) == 4


def test_rows_are_taken_by_index_or_by_truth_in_every_field() -> None:
    """A field that stayed behind would set torque against another sample's motion."""
    rows = make_rows([prepared()], [Payload(1.0, 0.1, 0.0)])
    chosen = rows.take(np.array([False, True, False, True]))
    for item in fields(Rows):
        values = getattr(rows, item.name)
        taken = getattr(chosen, item.name)
        np.testing.assert_array_equal(taken, values[[1, 3]] if isinstance(values, np.ndarray) else values)
    np.testing.assert_array_equal(rows.take(np.array([3, 0])).torque, [3.0, 0.0])


def test_no_block_spans_two_runs() -> None:
    """Runs of 3.9 s and 1.9 s in six blocks: four in the first, two in the second, none of them shared.

    A block across the seam would tie together residuals that have nothing to do with each other.
    """
    rows = make_rows([prepared(40), prepared(20)], [None, None])
    blocks = rows.blocks(6)
    np.testing.assert_array_equal(np.bincount(blocks), [10, 10, 10, 10, 10, 10])
    assert set(blocks[rows.run == 0]) == {0, 1, 2, 3} and set(blocks[rows.run == 1]) == {4, 5}
