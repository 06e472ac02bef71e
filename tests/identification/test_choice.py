"""Chosen friction law on logs with a known law, and the words of the reason."""

from __future__ import annotations

import numpy as np
import pytest

from equation import equation_rows
from shanks import ASYMMETRIC, GO1, LOADED_LEG, STRIBECK
from stiction.identification.choice import Candidate, Choice, choose_law
from stiction.identification.example import LEG, SATURN_LITE, Excitation, Motor, example_log
from stiction.identification.model import Law, Model
from stiction.identification.prepare import Rows
from stiction.identification.regression import fit_rows
from stiction.identification.runs import make_run
from stiction.identification.setup import IdentifySetup
from stiction.joints.friction import PositionDependent
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint

SLOW = Excitation((0.5, 0.2, 0.1), (0.1, 0.7, 2.0), 40.0)
"""Slow enough for the fall of the friction above rest to show through the filter that the encoder's noise asks for."""

KNEE = Motor("knee", Joint(0.0145, 0.0704, PositionDependent(0.35, 0.25, 0.3), -0.05), PDGains(20.0, 0.5, 45.0))
"""Saturn Lite's shank with friction that grows by half over the range."""

PLAIN = {"inertia": 0.02, "viscous_friction": 0.07, "coulomb_friction": 0.4, "offset": -0.05}


def chosen(motor: Motor, excitation: Excitation | None = None, seed: int = 0) -> Choice:
    """Choose the law of a simulated log, with the noise of a real one."""
    run = make_run(example_log(motor, excitation, seed=seed), None, IdentifySetup())
    return choose_law(run.rows, fit_rows(run.rows, run.model))


def chosen_of(rows: Rows, gravity: bool = False) -> dict[str, Candidate]:
    """Choose the law of made rows; return all candidates by name."""
    choice = choose_law(rows, fit_rows(rows, Model("coulomb", gravity)))
    return {candidate.law: candidate for candidate in choice.candidates}


def white(seed: int = 0, size: float = 0.05) -> np.ndarray:
    """Return white noise of the torque for `equation_rows` [N m]."""
    return size * np.random.default_rng(seed).standard_normal(2000)


@pytest.mark.parametrize(
    ("motor", "excitation", "law"),
    [
        (SATURN_LITE, None, "coulomb"),
        (SATURN_LITE, SLOW, "coulomb"),
        (LEG, None, "coulomb"),
        (ASYMMETRIC, None, "asymmetric"),
        (STRIBECK, SLOW, "stribeck"),
        (LOADED_LEG, None, "load"),
        (KNEE, None, "position"),
    ],
    ids=["plain", "plain_slow", "leg", "asymmetric", "stribeck", "loaded_leg", "knee"],
)
def test_the_law_that_made_the_log_is_chosen(motor: Motor, excitation: Excitation | None, law: Law) -> None:
    """Three logs of each law: the law of the log is chosen."""
    for seed in range(3):
        choice = chosen(motor, excitation, seed)
        assert choice.law == law, (seed, choice.candidates)
        verdicts = {candidate.law: candidate.verdict for candidate in choice.candidates}
        assert verdicts[law] == "chosen" and list(verdicts.values()).count("chosen") == 1
        assert verdicts["coulomb"] == ("chosen" if law == "coulomb" else "beaten")


def test_plain_friction_stays_plain() -> None:
    """The simplest within noise: on 20 logs of a plain joint a richer law is chosen at most once."""
    laws = [chosen(GO1, seed=seed).law for seed in range(20)]
    assert laws.count("coulomb") >= 19, laws


def test_the_sentence_says_what_was_gained() -> None:
    """In white noise of σ the asymmetric law of f = 0.5 and 0.3 leaves σ², plain friction σ² and what it lacks more.

    The symmetric fit takes the mean difference as an offset, so what it lacks is viscous friction of 0.03 either way.
    """
    values = {"inertia": 0.02, "viscous_friction_forward": 0.03, "viscous_friction_backward": 0.09}
    values |= {"coulomb_friction_forward": 0.5, "coulomb_friction_backward": 0.3}
    rows = equation_rows(values, noise=white())
    choice = choose_law(rows, fit_rows(rows, Model()))
    lacking = fit_rows(equation_rows(values), Model()).residual
    expected = np.mean(lacking**2) / (np.mean(lacking**2) + 0.05**2)
    candidate = next(candidate for candidate in choice.candidates if candidate.law == "asymmetric")
    assert candidate.gain == pytest.approx(expected, rel=0.1) and candidate.verdict == "chosen"
    assert candidate.held_out == pytest.approx(0.05 / np.sqrt(np.mean(rows.torque**2)), rel=0.05)
    assert candidate.gain > 2 * candidate.gain_std > 0


def test_the_load_law_needs_a_load() -> None:
    """Without gravity or a known external torque no load law is chosen."""
    assert "load" not in chosen_of(equation_rows(PLAIN, noise=white()))
    assert "load" in chosen_of(equation_rows(PLAIN, load=0.5, noise=white()))
    assert "load" in chosen_of(equation_rows(PLAIN | {"gravity_sin": 2.0}, noise=white()), gravity=True)


def test_friction_that_would_drive_the_joint_is_not_chosen() -> None:
    """Rejects a slope that makes friction of 0.2 negative at the end of the range."""
    made = PLAIN | {"coulomb_friction": 0.2, "position_slope": 0.5, "position_curvature": 0.0}
    choice = chosen_of(equation_rows(made, noise=white()))["position"]
    assert choice.gain > 0.1 and choice.verdict == "its friction would drive the joint"


def test_the_evidence_of_white_residuals_by_hand() -> None:
    """Evidence n ln(SS₀/SS₁) − Δp ln n, all n = 2000 rows being independent; the sums of squares are made here."""
    rows = equation_rows(PLAIN, noise=white(3))
    candidates = chosen_of(rows)
    up, down = rows.velocity > 0, rows.velocity < 0
    plain = np.column_stack([rows.acceleration, rows.velocity, np.sign(rows.velocity), np.ones(2000)])
    both = np.column_stack([rows.acceleration, rows.velocity * up, rows.velocity * down, up, -1.0 * down])
    away = rows.position - (rows.position.min() + rows.position.max()) / 2
    bent = np.column_stack([plain, rows.direction * away, rows.direction * away**2])
    squares = [float(np.linalg.lstsq(design, rows.torque)[1][0]) for design in (plain, both, bent)]
    for law, square, more in (("asymmetric", squares[1], 1), ("position", squares[2], 2)):
        expected = 2000 * np.log(squares[0] / square) - more * np.log(2000)
        assert candidates[law].evidence == pytest.approx(expected, abs=1e-6), law
        assert candidates[law].evidence < 0 and candidates[law].parameters == 4 + more
    assert candidates["coulomb"].evidence == 0.0
