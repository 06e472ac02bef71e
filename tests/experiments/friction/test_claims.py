"""Every sentence on made-up results: where the paper is right, where it is wrong, and where nothing is known."""

from dataclasses import replace

from stiction_experiments.friction.claims import CLAIMS
from stiction_experiments.friction.evidence import TrainingEvidence
from synthetic import condition_rows, curve, row

WALKS, STANDS, SLOW = (1.0, 0.98, 1.02), (0.05, 0.04, 0.06), (0.5, 0.52, 0.48)

NEVER = "V6"
"""The sentence on which no result bears."""


def curves_of(**walks_at: int) -> dict:
    """Three seeds of each method, one iteration-step apart."""
    runs = {f"coulomb20-{method}-s{s}": at + 10 * s for method, at in walks_at.items() for s in range(3)}
    return {run: curve(run, at) for run, at in runs.items()}


def paper_is_right() -> TrainingEvidence:
    """Direct training stands, the wide range walks, without friction in training one is slow from 10 % on."""
    rows = [
        *condition_rows("coulomb20-none", {0.0: WALKS, 0.01: WALKS, 0.1: SLOW, 0.2: SLOW}, tracking_error=0.02),
        *condition_rows("coulomb20-direct", {0.0: STANDS, 0.01: STANDS, 0.1: STANDS, 0.2: STANDS}),
        *condition_rows("coulomb20-deception", dict.fromkeys((0.0, 0.01, 0.1, 0.2), WALKS)),
        *condition_rows("coulomb20-compensation", {0.2: STANDS}),
        *condition_rows("coulomb20-finetune", {0.2: SLOW}),
        *condition_rows("coulomb20-iterative", {0.2: WALKS}, joint_jitter=400.0),
        *(row(f"coulomb20-iterative-s{s}/student", 0.2, "stand", None, tracking_error=0.3) for s in range(3)),
        *condition_rows("coulomb20-direct-strong", {0.2: WALKS}),
        *condition_rows("coulomb20-direct-weak", {0.2: STANDS}),
        *condition_rows("coulomb20-none-weak", {0.0: WALKS}),
        *condition_rows("coulomb20-narrow", {0.2: SLOW}),
        *(
            r
            for c in (0.05, 0.2)
            for r in condition_rows(f"load{round(1000 * c)}-direct", {c: WALKS}, friction_law="load")
        ),
        *condition_rows("load442-direct", {0.442: STANDS}, friction_law="load"),
    ]
    for index, cell in enumerate(rows):
        if cell.policy.startswith("coulomb20-none") and cell.command == "vx=0.5":
            rows[index] = row(cell.policy, cell.friction_level, "vx=0.5", cell.speed_ratio, tracking_error=0.021)
    return TrainingEvidence.of_runs(rows, curves_of(none=100, deception=150, direct=300))


def paper_is_wrong() -> TrainingEvidence:
    """Everything walks as well as everything else, except that deception is worst where it should be best."""
    rows = [
        *condition_rows("coulomb20-none", dict.fromkeys((0.0, 0.01, 0.1, 0.2), WALKS), tracking_error=0.09),
        *condition_rows("coulomb20-direct", dict.fromkeys((0.0, 0.01, 0.1, 0.2), WALKS)),
        *condition_rows("coulomb20-deception", dict.fromkeys((0.0, 0.01, 0.1, 0.2), SLOW)),
        *condition_rows("coulomb20-compensation", {0.2: WALKS}),
        *condition_rows("coulomb20-finetune", {0.2: WALKS}),
        *condition_rows("coulomb20-iterative", {0.2: WALKS}),
        *(row(f"coulomb20-iterative-s{s}/student", 0.2, "stand", None, tracking_error=0.01) for s in range(3)),
        *condition_rows("coulomb20-direct-strong", {0.2: STANDS}),
        *condition_rows("coulomb20-direct-weak", {0.2: WALKS}),
        *condition_rows("coulomb20-none-weak", {0.0: WALKS}),
        *condition_rows("coulomb20-narrow", {0.2: WALKS}),
        *(
            r
            for c in (0.05, 0.2, 0.442)
            for r in condition_rows(f"load{round(1000 * c)}-direct", {c: WALKS}, friction_law="load")
        ),
    ]
    return TrainingEvidence.of_runs(rows, curves_of(none=300, deception=200, direct=100))


def outcomes(evidence: TrainingEvidence) -> dict[str, str]:
    """Sentence -> outcome."""
    return {claim.id: claim.verdict(evidence).outcome for claim in CLAIMS}


def test_results_as_the_paper_tells_them() -> None:
    """Every sentence reproduces on results that the paper describes."""
    expected = {claim.id: "reproduces" for claim in CLAIMS}
    expected |= {NEVER: "not tested", "V2, as load": "only above x", "A1": "only above x"}
    assert outcomes(paper_is_right()) == expected
    evidence = {claim.id: claim.verdict(paper_is_right()).evidence for claim in CLAIMS}
    assert evidence["A1"].startswith("x = 0.01;") and evidence["V2, as load"].startswith("x = 0.2;")


def test_results_against_the_paper() -> None:
    """Every sentence is refuted on results that contradict the paper."""
    assert outcomes(paper_is_wrong()) == {c.id: "not tested" if c.id == NEVER else "does not" for c in CLAIMS}


def test_one_seed_carries_no_verdict() -> None:
    """No sentence is decided by one seed."""
    right = paper_is_right()
    first = {cell: {0: seeds[0]} for cell, seeds in right.cells.items()}
    curves = {run: points for run, points in right.curves.items() if run.endswith("-s0")}
    assert set(outcomes(TrainingEvidence(first, curves=curves)).values()) == {"not tested"}


def test_a_robot_that_walks_one_way_is_neither_stationary_nor_following() -> None:
    """V2 is about both directions, C1 about either."""
    rows = condition_rows("coulomb20-direct", {0.2: WALKS}, backward=0.0)
    verdicts = outcomes(TrainingEvidence.of_runs(rows))
    assert verdicts["V2"] == "does not" and verdicts["C1"] == "reproduces"


def test_falls_count_against_deception() -> None:
    """A policy that follows but falls in half of its walks fails."""
    rows = condition_rows("coulomb20-deception", {0.0: WALKS, 0.2: WALKS}, fall_rate=0.5)
    assert outcomes(TrainingEvidence.of_runs(rows))["V9"] == "does not"


def test_one_fall_refutes_that_nobody_falls() -> None:
    """One of 16 walks of one seed, in one direction."""
    rows = condition_rows("coulomb20-deception", {0.0: WALKS, 0.2: WALKS})
    assert outcomes(TrainingEvidence.of_runs(rows))["V9"] == "reproduces"
    rows[-1] = replace(rows[-1], fall_rate=1 / 16)
    assert outcomes(TrainingEvidence.of_runs(rows))["V9"] == "does not"


def test_no_fall_is_as_sure_as_there_are_walks() -> None:
    """The rates of all seeds are zero, an interval over seeds of no width. Wilson's over 5 seeds of 16 walks ends at
    3.8415 / (80 + 3.8415) = 0.046, under a third; over 3 seeds of 2 walks at 3.8415 / (6 + 3.8415) = 0.390.
    """
    for seeds, episodes, interval, outcome in (
        (5, 16, "80 trials [0.00, 0.05]", "reproduces"),
        (3, 2, "6 trials [0.00, 0.39]", "undecided"),
    ):
        ratios = [0.99 + 0.005 * seed for seed in range(seeds)]
        rows = condition_rows("coulomb20-deception", {0.0: ratios, 0.2: ratios}, episodes=episodes)
        (v9,) = (claim.verdict(TrainingEvidence.of_runs(rows)) for claim in CLAIMS if claim.id == "V9")
        assert v9.outcome == outcome and v9.evidence.count(interval) == 4


def test_weak_exploration_that_never_learns_says_nothing_of_friction() -> None:
    """Friction filters only exploration that learns without friction."""
    rows = [
        *condition_rows("coulomb20-direct-strong", {0.2: WALKS}),
        *condition_rows("coulomb20-direct-weak", {0.2: STANDS}),
        *condition_rows("coulomb20-none-weak", {0.0: (-0.05, -0.04, -0.06)}),
    ]
    assert outcomes(TrainingEvidence.of_runs(rows))["V4"] == "does not"
    assert outcomes(TrainingEvidence.of_runs(rows[:-6]))["V4"] == "not tested"


def test_one_weakness_at_which_friction_filters_suffices() -> None:
    """The weaker one learns nothing with or without friction; the stronger of the two walks where there is none."""
    rows = [
        *condition_rows("coulomb20-direct-strong", {0.2: WALKS}),
        *condition_rows("coulomb20-direct-weak", {0.2: STANDS}),
        *condition_rows("coulomb20-none-weak", {0.0: (-0.05, -0.04, -0.06)}),
        *condition_rows("coulomb20-direct-mid", {0.2: STANDS}),
        *condition_rows("coulomb20-none-mid", {0.0: WALKS}),
    ]
    assert outcomes(TrainingEvidence.of_runs(rows))["V4"] == "reproduces"
