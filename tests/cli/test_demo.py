"""The demo: every stage runs, the page stands alone, and what is missing is said and costs nothing else."""

import json
import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest

from bundles import make_bundle, make_contract
from stiction.cli import demo
from stiction.cli.main import main
from stiction.files.following import COMMAND_SET

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

pytestmark = pytest.mark.usefixtures("undrawn")

SHORT = ["--episodes", "1", "--seconds", "3.5"]


@pytest.fixture
def bundles(tmp_path: Path) -> list[str]:
    """Two policies of different methods."""
    contracts = {name: make_contract(method=name) for name in ("none", "direct")}
    contracts["direct"] = replace(contracts["direct"], friction_range=(0.16, 0.24))
    return [str(make_bundle(tmp_path / "bundles" / f"toy-{name}", contract)) for name, contract in contracts.items()]


@pytest.mark.slow
def test_the_page_holds_every_stage_and_needs_no_network(
    bundles: list[str], tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A newcomer opens one file."""
    monkeypatch.delenv("STICTION_DATA", raising=False)
    out = tmp_path / "demo"
    assert main(["demo", "--out", str(out), "--bundles", *bundles, *SHORT, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    walked = [(row["friction_level"], row["command"]) for row in summary["rows"] if row["policy"] == "toy-none"]
    assert walked == [(level, command) for level in (0, 0.12, 0.24, 0.36) for command in demo.COMMANDS]
    assert set(demo.COMMANDS) < set(COMMAND_SET)
    assert not [text for text in summary["warnings"] if "OpenGL" not in text]
    page = (out / "report.html").read_text()
    told = summary["joints"]["shank"]["diagnostics"]["verdict"]["lines"]
    assert len(told) == 3 and all(line in unescape(re.sub("</?code>", "`", page)) for line in told)
    for text in (
        "Friction from a log",
        "16 to 24 %",
        "toy-direct",
        "trained without friction",
        "trained at 20 % friction",
        "stiction identify",
        "Inertia",
        summary["policies"]["toy-none"]["digest"][:16],
    ):
        assert text in page
    assert re.search(r"Trained without friction, it follows (all 4 commands|[0-3] of 4) (at|from) .* 36 %", page)
    assert "Walked here: vx=0.5, vx=-0.5, vy=0.3, wz=0.5; stiction evaluate walks all fifteen commands." in page
    assert 'src="http' not in page
    assert "<script" not in page
    assert (out / "evaluation" / "results.csv").is_file()
    assert (out / "example" / "joints.json").is_file()
    rendered = (out / "side-by-side.webp").is_file()
    assert rendered or any("OpenGL" in text for text in summary["warnings"])
    assert page.count("data:image/webp") == int(rendered)


def test_training_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three quarters of an hour of training must survive an interruption."""
    train = pytest.importorskip("stiction.cli.train", reason="the extra 'train' is needed to train")
    export = pytest.importorskip("stiction.evaluation.export", reason="the extra 'train' is needed to export")
    called: list[list[str]] = []
    monkeypatch.setattr(train, "main", lambda arguments: called.append(arguments))
    monkeypatch.setattr(export, "export_run", lambda run, bundle: bundle.mkdir(parents=True))
    cfg = demo.DemoCfg(out=tmp_path, train=True)
    (tmp_path / "runs" / "direct").mkdir(parents=True)
    (tmp_path / "runs" / "direct" / "config.json").write_text("{}")
    (tmp_path / "policies" / "saturn_lite-flat-deception-0.2").mkdir(parents=True)
    paths = demo._find_policies(cfg, [])
    assert [path.name for path in paths] == [f"saturn_lite-flat-{name}-0.2" for name in ("none", "direct", "deception")]
    fresh, resumed = called
    assert fresh[fresh.index("--method") + 1] == "none"
    assert fresh[fresh.index("--friction-level") + 1] == "0.2"
    assert resumed == ["--resume", str(tmp_path / "runs" / "direct")]


def test_an_altered_bundle_stops_the_demo_in_one_line(
    bundles: list[str], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Refuses a bundle that fails its check and names the altered file."""
    (Path(bundles[0]) / "card.md").write_text("altered")
    assert main(["demo", "--out", str(tmp_path / "demo"), "--bundles", *bundles, *SHORT]) == 1
    assert "card.md" in capsys.readouterr().err.splitlines()[-1]
