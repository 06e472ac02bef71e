"""Methods that add friction to the command, or bring it in later: their runs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stiction.core.errors import StictionError
from stiction.evaluation.export import export_run
from stiction.learning.config import TrainCfg
from stiction.learning.run import RunDirectory
from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg


def test_a_run_of_compensation_by_the_error_is_refused(tmp_path: Path) -> None:
    """Its policy would be exported, or trained on, as one that goes by the speed of the joints."""
    cfg = TrainCfg(task=TaskCfg(friction=FrictionCfg("compensation", level=0.2)))
    run = RunDirectory.create(tmp_path / "run", cfg, "stiction train", None)
    assert run.config() == run.config_to_train() == cfg
    file = run.path / "config.json"
    header = json.loads(file.read_text())
    assert header.pop("compensation") == "measured"
    file.write_text(json.dumps(header))
    for read in (run.config, run.config_to_train, lambda: export_run(run.path, tmp_path / "bundle")):
        with pytest.raises(
            StictionError, match="run: friction was added by the error, expected by the speed; train it"
        ):
            read()
    header["config"]["task"]["friction"]["method"] = "direct"
    file.write_text(json.dumps(header))
    assert run.config().task.friction.method == "direct"
