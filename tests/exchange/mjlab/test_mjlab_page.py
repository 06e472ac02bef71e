"""The page for people who train in mjlab, from an empty folder on, as far as a CPU goes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("mjlab", reason="the package mjlab is not installed here; `make test-mjlab` makes its environment")

import torch
from mjlab.envs import ManagerBasedRlEnv

from code_blocks import MADE, blocks_of, files_of
from stiction.cli.main import main
from stiction.mjlab import IdentifiedActuatorCfg

PAGE = Path(__file__).parents[3] / "docs/trainers.md"
LITTLE = ("--gpu-ids", "None", "--env.scene.num-envs", "4", "--agent.max-iterations", "1")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.usefixtures("undrawn")
def test_the_page_runs_from_top_to_bottom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands as printed; its file trains an iteration; then the other blocks of Python, in one script."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    for name in files_of(PAGE):
        MADE[name](tmp_path / name)
    names: dict[str, Any] = {"__name__": "__page__"}
    for block in blocks_of(PAGE):
        ours = Path(__file__).name in block.reason or "one line of" in block.reason
        if block.language == "python" and ours:
            if block.text.startswith("# "):
                file = tmp_path / block.text.splitlines()[0].removeprefix("# ")
                file.write_text(block.text)
                continue
            exec(compile(block.text, f"{PAGE.name}:{block.line}", "exec"), names)
        for words in block.commands if block.language == "console" else ():
            if block.how == "run":
                assert main(words[1:]) == 0
            elif ours:
                assert words[:2] == ["python", file.name]
                ended = subprocess.run(
                    [sys.executable, *words[1:], *LITTLE], capture_output=True, text=True, timeout=550, check=False
                )
                assert ended.returncode == 0, ended.stderr
    added = file.read_text().partition("def changed(cfg):\n")[2].partition("    return cfg")[0]
    assert len(added.splitlines()) == 3
    (network,) = tmp_path.glob("logs/rsl_rl/go1_velocity/*/*.onnx")
    assert network.stat().st_size > 1e5

    # What the last blocks made: the friction law in the calves, and a log.
    cfg = names["cfg"]
    by_law = [one for one in cfg.scene.entities["robot"].articulation.actuators if type(one) is IdentifiedActuatorCfg]
    assert len(by_law) == 1 and by_law[0].coulomb_friction == pytest.approx(0.442, rel=0.05)
    assert (cfg.sim.mujoco.iterations, cfg.sim.mujoco.ls_iterations) == (20, 50)
    cfg.scene.num_envs = 2
    env = ManagerBasedRlEnv(cfg, device="cpu")
    env.reset()
    for _ in range(3):
        observed, *_ = env.step(torch.zeros(2, env.action_manager.total_action_dim))
    env.close()
    assert observed["actor"].isfinite().all() and (tmp_path / "leg.csv").exists()
