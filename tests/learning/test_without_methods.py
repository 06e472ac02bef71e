"""The product alone, as where no distribution brings a training method: what it trains, reads, and says of the rest."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from method_entries import without_methods
from stiction.core.errors import ConfigurationError, FileError
from stiction.evaluation.evaluate import EvaluationCfg, evaluate_bundle
from stiction.evaluation.policies import method_of
from stiction.files import method as methods
from stiction.files.bundle import find_bundle, read_bundle, write_bundle
from stiction.learning.arguments import parse
from stiction.learning.begin import begin_run
from stiction.learning.run import RunDirectory, identified_values
from stiction.learning.runner import train
from stiction.learning.stored import FORMER_GROUPS
from stiction.task.friction import FrictionCfg

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

SHORT = ("--robot", "go1", "--num-envs", "8", "--teacher.iterations", "1", "--video-every", "0")


@pytest.mark.parametrize("method", ["none", "deception"])
def test_methods_of_the_product_are_trained(method: str, tmp_path: Path) -> None:
    """A run of today, and one of before methods were installed, whose config.json has groups of theirs."""
    with without_methods():
        cfg = parse(["--preset", "quick", "--method", method, "--friction-level", "0.2", *SHORT]).config
        run, cfg = begin_run(tmp_path / "run", cfg, "stiction train")
        assert train(cfg, run, identified_values(run.header()))["last"]["teacher"]["iteration"] == 1
        file = run.path / "config.json"
        header = json.loads(file.read_text())
        header["config"].pop("method_settings")
        header["config"] |= {name: {"eta": 2.0} for name in FORMER_GROUPS}
        file.write_text(json.dumps(header))
        assert RunDirectory(run.path).config() == cfg and cfg.method_settings is None
        header["config"]["other"] = {"eta": 2.0}
        file.write_text(json.dumps(header))
        with pytest.raises(FileError, match="TrainCfg has no field 'other'"):
            RunDirectory(run.path).config()


def test_a_method_that_is_not_installed_is_named_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On the command line, in Python, and in a run."""
    missing = r"^the method '{}' needs stiction-experiments, which is not installed; install it with: pip install "
    with without_methods():
        with pytest.raises(ConfigurationError, match=missing.format("hinf")):
            FrictionCfg("hinf")
        with pytest.raises(ConfigurationError, match="unknown friction method 'deceptoin'; did you mean 'deception'"):
            FrictionCfg("deceptoin")
        with pytest.raises(ConfigurationError, match=missing.format("dreamwaq")):
            parse(["--method", "dreamwaq"])
        with pytest.raises(SystemExit):
            parse(["--method", "nosuch"])
        printed = capsys.readouterr().err
        assert "--method 'nosuch'; expected none, direct, deception, " in printed and printed.count("\n") == 1
    run, _ = begin_run(tmp_path / "run", parse(["--method", "dreamwaq", *SHORT]).config, "stiction train")
    with without_methods(), pytest.raises(ConfigurationError, match=missing.format("dreamwaq")):
        run.config()
    assert run.config().method.name == "dreamwaq"


@pytest.mark.parametrize(
    ("method", "fields"),
    [
        ("compensation", {"compensation": (0.01,) * 18, "compensation_speeds": (0.2, 0.3)}),
        ("dreamwaq", {}),
        ("hinf", {"disturber": "force"}),
    ],
)
def test_a_policy_of_any_method_walks(method: str, fields: dict[str, Any], tmp_path: Path) -> None:
    """To the numbers that it walks with beside its method."""
    shipped = read_bundle(find_bundle(Path("saturn_lite-flat-deception-0.2")))
    assert shipped.contract.settings is not None
    settings = shipped.contract.settings | {"task.friction.method": method}
    contract = replace(shipped.contract, method=method, settings=settings, **fields)
    path = write_bundle(tmp_path / method, contract, shipped.policy, shipped.golden, shipped.card)
    cfg = EvaluationCfg(commands=("vx=0.5",), friction_levels=(0.1,), episodes=2, seconds=2.0, settle=0.5)
    with without_methods():
        bundle = read_bundle(path)
        (row,) = evaluate_bundle(bundle, cfg).rows
        assert row.method == bundle.contract.method
    (again,) = evaluate_bundle(bundle, cfg).rows
    assert again.method == method_of(bundle.contract) and replace(again, method=row.method) == row


def test_a_method_that_fails_to_load_stops_nobody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """Names the missing distribution; a training of the product's own goes on."""

    def broken(group: str, name: str) -> None:
        raise ConfigurationError(f"{name} failed to load; reinstall its distribution")

    monkeypatch.setattr(methods, "installed_names", lambda group: ["odd"])
    monkeypatch.setattr(methods, "find_installed", broken)
    methods.known_method.cache_clear()
    assert methods.installed_methods() == [] and parse(["--method", "none"]).config.method.name == "none"
    with pytest.raises(ConfigurationError, match="odd failed to load"):
        methods.find_method("odd")
    methods.known_method.cache_clear()
