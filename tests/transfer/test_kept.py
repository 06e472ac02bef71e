"""Parts of studies that are kept: what makes one count, and what does not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from stiction.formats.errors import StictionError
from stiction.formats.reproducibility import PACKAGE
from stiction.transfer import kept
from stiction.transfer.kept import RUN_WALKING, WALKING, keep
from stiction.transfer.robot.identification import MAKING
from stiction.transfer.wear_study import WEARING
from test_house import BY_NAME, NAMES, all_imports

BY_FILE = {name: path for path, name in NAMES.items()}
"""Path below the package -> module."""


def made(folder: Path, value: float, made_from: dict[str, Any] | None = None) -> dict[str, Any]:
    """Keep a number."""
    return keep(folder, "part", made_from or {"seed": 1}, ("transfer/kept.py",), lambda: {"value": value})


def test_a_part_is_made_once_for_the_same_settings(tmp_path: Path) -> None:
    """The second number would be the first one's if settings did not count, the third a waste if they always did."""
    assert made(tmp_path, 1.0) == {"value": 1.0}
    assert made(tmp_path, 2.0) == {"value": 1.0}
    assert made(tmp_path, 3.0, {"seed": 2}) == {"value": 3.0}
    assert sorted(file.suffix for file in tmp_path.iterdir()) == [".json", ".json"]


@pytest.mark.parametrize("change", [{"code": "other", "packages": {}}, {"code": "", "packages": {"sapien": "4"}}])
def test_other_code_or_packages_make_it_anew(change: dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What another engine measured would go by the new one's name."""
    monkeypatch.setattr(kept, "made_by", lambda *code: {"code": "", "packages": {}})
    assert made(tmp_path, 1.0) == made(tmp_path, 2.0) == {"value": 1.0}
    monkeypatch.setattr(kept, "made_by", lambda *code: change)
    assert made(tmp_path, 2.0) == {"value": 2.0}


def test_a_part_that_fails_leaves_nothing(tmp_path: Path) -> None:
    """Half a part would be read as a whole one."""
    with pytest.raises(ValueError, match="JSON"):
        made(tmp_path, float("nan"))
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_none_is_said_in_one_line(tmp_path: Path) -> None:
    """With the way out."""
    made(tmp_path, 1.0)
    next(tmp_path.iterdir()).write_text("half")
    with pytest.raises(StictionError, match="remove it, or give another --out"):
        made(tmp_path, 1.0)


READING = {
    f"formats/{name}.py"
    for name in ("actuator", "bundle", "errors", "gemm", "golden", "grid", "joints", "results", "sidecar", "tables")
}
"""Code that reads and refuses files, whose content is in every key, or names columns and ways; and speed."""

WIRING = {"locomotion/config.py", "transfer/grid/plan.py"}
"""Configuration, whose values are in every key: noise, what a walk is."""

TRAINING = {
    *(f"locomotion/{name}.py" for name in ("commands", "device", "env", "gait", "randomization", "rewards")),
    *(f"rma/{name}.py" for name in ("board", "checkpoint", "config", "figures", "health", "phase", "run", "stop")),
    *("rma/ppo.py", "rma/quick.py", "rma/symmetry.py"),
    *("formats/configuration.py", "formats/metrics.py", "joints/actuator.py"),
    *("transfer/card.py", "transfer/golden.py", "deploy/check.py", "deploy/onnx_file.py", "deploy/policy.py"),
}
"""Code that trained and exports, which the modules around a run's policies import: weights and settings are in keys."""

BENCHED = {
    *(f"formats/{name}.py" for name in ("contract", "known_friction", "observation", "parquet")),
    *("locomotion/friction.py", "locomotion/terrain.py"),
    *(f"sim/{name}.py" for name in ("fleet", "native", "protocol", "slider", "terrain")),
    *("deploy/observation.py", "deploy/onnx_file.py", "deploy/policy.py"),
    *("transfer/command.py", "transfer/course.py", "transfer/metrics.py", "transfer/rollout.py"),
}
"""Code of walks: the robot on its stand shares modules with the one that walks, and goes nowhere."""

WEAR = {"formats/wear.py", "deploy/wear.py"}
"""The monitor, which only listens."""


def imported(start: str) -> set[str]:
    """Return every module of the package that a module leads to, itself included, at the top of modules or inside."""
    seen, waiting = {BY_FILE[start]}, [BY_FILE[start]]
    while waiting:
        path = waiting.pop()
        names = {name for name, _ in all_imports(path)}
        names |= {name.rpartition(".")[0] for name in names}
        new = {BY_NAME[name] for name in names if name in BY_NAME} - seen
        seen |= new
        waiting += new
    return {NAMES[path] for path in seen if path.name != "__init__.py"}


@pytest.mark.parametrize(
    ("start", "code", "known"),
    [
        ("transfer/grid/walk.py", WALKING, READING | WIRING | WEAR | {"transfer/ways.py"}),
        ("transfer/wear_seen.py", WEARING, READING | WIRING),
        ("transfer/run_evaluation.py", RUN_WALKING, READING | WIRING | TRAINING | WEAR),
        ("transfer/robot/identification.py", MAKING, READING | WIRING | BENCHED | WEAR),
    ],
)
def test_code_that_decides_is_in_the_key(start: str, code: tuple[str, ...], known: set[str]) -> None:
    """A change of the random streams, or of how gains are read, would pass for the old results."""
    counted = {file.relative_to(PACKAGE).as_posix() for pattern in code for file in PACKAGE.glob(pattern)}
    assert sorted(imported(start) - counted - known) == []


@pytest.mark.parametrize("code", [WALKING, RUN_WALKING, WEARING, MAKING])
def test_every_part_of_the_walking_code_is_there(code: tuple[str, ...]) -> None:
    """A file that was renamed would no longer count, and nobody would see it."""
    assert [pattern for pattern in code if not list(PACKAGE.glob(pattern))] == []
