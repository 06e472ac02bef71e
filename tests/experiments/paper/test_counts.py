"""Counts of commands and their part of the advice, from rows made by hand and from the committed ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from stiction.core.errors import FileError
from stiction.core.records import read_rows
from stiction.files.advice import TRAINING, read_advice
from stiction.files.following import CommandCount
from stiction.files.results import ResultRow, read_results, write_results
from stiction.identification.advice import advise
from stiction_experiments.paper.counts import main, read_tables, way_of

DEVELOPMENT = Path(__file__).parents[3] / "results/following/development.csv"

TRAINED = ("--command", "stiction train --preset quick", "--revision", "abc")


def development(policy: str, engine: str) -> list[ResultRow]:
    """Return the rows of one committed policy in one engine: 15 commands at 0, 10, 20 and 24 %."""
    return [row for row in read_results(DEVELOPMENT) if (row.policy, row.engine) == (policy, engine)]


def cohort(method: str, policies: dict[int, str], engine: str = "mujoco", end: str = "") -> list[ResultRow]:
    """Return rows named as a cohort's. policies: seed -> committed policy that lends its velocities; end: of a name."""
    return [
        replace(row, policy=f"coulomb20-cohort-{method}-s{seed}{end}", method=method, seed=seed)
        for seed, policy in policies.items()
        for row in development(policy, engine)
    ]


def test_one_command_writes_counts_pairs_and_advice(tmp_path: Path) -> None:
    """`chosen` follows 60 of 60 cells in MuJoCo and PhysX, `plain` 49 and 36 (results/following/README.md)."""
    lent = {10: "plain", 11: "chosen", 12: "plain"}
    rows = [*cohort("deception", dict.fromkeys((10, 11, 12), "chosen")), *cohort("none", lent), *cohort("told", lent)]
    rows += cohort("deception", {10: "plain"}, end="-plain")
    write_results(tmp_path / "cohort-mujoco.csv", rows)
    write_results(tmp_path / "cohort-physx.csv", cohort("deception", {10: "chosen", 11: "plain"}, "physx"))
    tables = [str(tmp_path / f"cohort-{engine}.csv") for engine in ("mujoco", "physx")]
    main([str(tmp_path), *tables, "--advice", str(tmp_path / "advice.json"), *TRAINED])
    counts = read_rows(tmp_path / "counts.csv", CommandCount)
    followed: dict[tuple[str, str], int] = {}
    for count in counts:
        place = count.method, count.engine
        followed[place] = followed.get(place, 0) + count.followed
    assert followed == {
        ("deception", "mujoco"): 180,
        ("none", "mujoco"): 49 + 60 + 49,
        ("told", "mujoco"): 49 + 60 + 49,
        ("deception-plain", "mujoco"): 49,
        ("deception", "physx"): 60 + 36,
    }
    assert (tmp_path / "counts.png").read_bytes()[:4] == b"\x89PNG"
    text = (tmp_path / "counts.md").read_text()
    assert "| deception | 3 of 3 | 1 of 2 | 4 of 5 |" in text and "| none | 1 of 3 | – | 1 of 3 |" in text
    assert "| none | mujoco | 24 % | 1 of 3 | 35 of 45 | 0.083 | wz=0.5: too slow |" in text
    source = read_advice(tmp_path / "advice.json")[TRAINING]
    assert list(source.methods) == ["deception", "none", "told"] and source.tables[1] == "cohort-physx.csv"
    assert not any(policy.endswith("-plain") for policy in source.policies)
    told = advise(0.1, 0.2, {TRAINING: source})
    assert told.method == "deception" and told.covered and told.flags == "--method deception --friction-level 0.2"
    assert told.command.endswith(" --preset quick") and "in PhysX deception 1 of 2 seeds at 20 %" in told.comparison


def test_tables_that_cannot_be_counted_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Two policies of one seed would count as one; older rows cannot be judged; advice names its training."""
    with pytest.raises(FileError, match="both of 'deception' with seed 0 in mujoco"):
        read_tables([DEVELOPMENT])
    write_results(tmp_path / "older.csv", [replace(row, mean_vx=None) for row in development("plain", "mujoco")])
    with pytest.raises(FileError, match="got 60 rows without a mean velocity"):
        read_tables([tmp_path / "older.csv"])
    with pytest.raises(SystemExit):
        main([str(tmp_path), str(DEVELOPMENT), "--advice", str(tmp_path / "advice.json")])
    assert "--advice requires --command" in capsys.readouterr().err
    row = development("plain", "mujoco")[0]
    assert way_of(row) == "deception" and way_of(replace(row, policy="a-s0-plain")) == "deception-plain"
