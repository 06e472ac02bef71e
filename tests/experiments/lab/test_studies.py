"""The studies of damping and gait as commands: they write what they say, and refuse what they cannot do."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from bundles import make_bundle, make_contract
from stiction.cli.main import main

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")


@pytest.fixture
def walker(tmp_path: Path) -> Path:
    """A bundle whose training command tells that it was trained without r_trot."""
    contract = make_contract(command="stiction train --task.rewards.trot 0", seed=3)
    return make_bundle(tmp_path / "walker", contract)


def read(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_gait_writes_tables_contacts_figure_and_page(walker: Path, tmp_path: Path, capsys) -> None:
    """Everything that the page shows can be had as numbers."""
    out = tmp_path / "gait"
    options = ["--commands", "vx=0.5", "--episodes", "2", "--seconds", "4", "--out", str(out), "--json"]
    assert main(["study", "gait", str(walker), *options]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["policies"]["walker"]["variant"] == "no-trot"
    (row,) = read(out / "gaits.csv")
    assert (row["policy"], row["variant"], row["seed"], row["command"]) == ("walker", "no-trot", "3", "vx=0.5")
    feet = read(out / "feet.csv")
    assert [foot["foot"] for foot in feet] == ["FL", "ML", "RL", "FR", "MR", "RR"]
    assert [foot["group"] for foot in feet] == ["0", "1", "0", "1", "0", "1"]
    assert len(read(out / "claims.csv")) == 3
    with np.load(out / "contacts.npz", allow_pickle=False) as contacts:
        assert contacts["walker vx=0.5"].shape == (100, 6)
    assert "three-legged hopping" in (out / "report.html").read_text()
    assert (out / "gait.png").stat().st_size > 1000


def test_gait_refuses_what_it_cannot_name_or_measure(walker: Path, bundle: Path, tmp_path: Path, capsys) -> None:
    """A hand-made bundle does not tell its rewards, standing has no gait, variants are given for all or for none."""
    out = ["--out", str(tmp_path / "out"), "--episodes", "1", "--seconds", "3"]
    for arguments, message in (
        ([str(bundle)], "--variants"),
        ([str(walker), "--commands", "stand"], "no gait"),
        ([str(walker), "--variants", "both", "both"], "2 variants for 1"),
        ([str(walker), str(walker)], "two bundles are called 'walker'"),
    ):
        assert main(["study", "gait", *arguments, *out]) == 1
        assert message in capsys.readouterr().err
    assert main(["study", "gait"]) == 2


def test_policies_of_different_trainings_are_no_seeds(walker: Path, tmp_path: Path, capsys) -> None:
    """Two training methods, both with the same gait rewards, would pass for two seeds of one training."""
    command = "stiction train --task.rewards.trot 0"
    other = make_bundle(tmp_path / "other", make_contract(command=command, seed=4, method="direct"))
    again = make_bundle(tmp_path / "again", make_contract(command=command, seed=4))
    options = [
        "--commands",
        "vx=0.5",
        "--episodes",
        "1",
        "--seconds",
        "3",
        "--out",
        str(tmp_path / "gait"),
        "--json",
        "--overwrite",
    ]
    for second, message in ((other, "more than gait rewards and seed"), (again, "not evaluated")):
        assert main(["study", "gait", str(walker), str(second), *options]) == 0
        claims = json.loads((tmp_path / "gait" / "summary.json").read_text())["claims"]
        assert {claim["outcome"] for claim in claims} == {"not tested"}
        assert all(message in claim["evidence"] for claim in claims)
    capsys.readouterr()


def test_damping_writes_tables_figure_and_page(bundle: Path, tmp_path: Path, capsys) -> None:
    """The page leads with the answer."""
    out = tmp_path / "damping"
    options = [
        "--bundles",
        str(bundle),
        "--episodes",
        "1",
        "--draws",
        "2",
        "--robots",
        "go1",
        "--seconds",
        "2.1",
        "--out",
        str(out),
    ]
    assert main(["study", "damping", *options]) == 0
    assert "B + k·kd" in capsys.readouterr().out
    assert {row["case"] for row in read(out / "swaps.csv")} >= {"dry friction", "torque limit", "sampled"}
    assert {row["policy"] for row in read(out / "robots.csv")} == {"in the air", "toy"}
    assert (out / "damping.png").stat().st_size > 1000
    page = (out / "report.html").read_text()
    assert "Actuator Net" in page and "http" not in page.replace("http://www.w3.org", "")


def test_physics_writes_its_rows_and_says_how_far_they_are(bundle: Path, tmp_path: Path, capsys, monkeypatch) -> None:
    """The numbers behind the sentence, a row a policy, level, direction and physics."""
    from stiction.robots.physics import EXACT, FAST
    from stiction_experiments.physics import walks as physics_study

    settings = {physics_study.REFERENCE: (EXACT, 0.005), "rows": (EXACT, 0.005), "plastic": (FAST, 0.005)}
    monkeypatch.setattr(physics_study, "SETTINGS", settings)
    out = tmp_path / "physics"
    options = ["--friction-levels", "0", "0.1", "--episodes", "2", "--seconds", "3", "--out", str(out)]
    assert main(["study", "physics", str(bundle), *options]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert [line.partition("  ")[0] for line in printed] == list(settings)
    rows = read(out / "physics.csv")
    assert len(rows) == 3 * 2 * 2 and {row["policy"] for row in rows} == {"toy"}
    summary = json.loads((out / "summary.json").read_text())
    assert summary["walks"]["episodes"] == 2 and summary["bias"].keys() == settings.keys()
    assert main(["study", "physics", *options]) == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["study", "physics", "--seconds", "nan"], "16 walks of nan s at 0.5 m/s: expected at least 2"),
        (["study", "gait", "--seconds", "nan"], "nan"),
        (["study", "paper", "--out", "{file}"], "is a file; choose another --out"),
        (["study", "wear", "--out", "{file}/in"], "is a file; choose another --out"),
        (["replicate", "--out", "{file}/in"], "is a file; choose another --out"),
    ],
)
def test_what_cannot_be_done_is_said_before_any_work(words: list[str], message: str, tmp_path: Path, capsys) -> None:
    """NaN passes every comparison with `<`, and a folder that cannot be made is no news after an hour."""
    file = tmp_path / "file"
    file.write_text("")
    words = [word.format(file=file) for word in words]
    names = [] if words[0] == "replicate" or words[1] == "paper" else ["no-such-bundle"]
    out = [] if "--out" in words else ["--out", str(tmp_path / "out")]
    assert main([*words[:2], *names, *words[2:], *out] if names else [*words, *out]) == 1
    printed = capsys.readouterr().err
    assert message in printed and printed.count("\n") == 1 and "unforeseen" not in printed
    assert [*tmp_path.iterdir()] == [file]
