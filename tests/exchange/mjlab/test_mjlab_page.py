"""The page for people who train in mjlab, from an empty folder on, as far as a CPU goes."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("mjlab", reason="the package mjlab is not installed here; `make test-mjlab` makes its environment")

from code_blocks import MADE, blocks_of, files_of
from stiction.cli.main import main

PAGE = Path(__file__).parents[3] / "docs/mjlab.md"


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.usefixtures("undrawn")
def test_the_page_runs_from_top_to_bottom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands of ours, then the blocks of Python that say that this test runs them, in one script."""
    monkeypatch.chdir(tmp_path)
    for name in files_of(PAGE):
        MADE[name](tmp_path / name)
    script: list[str] = []
    for block in blocks_of(PAGE):
        if block.language == "python" and (Path(__file__).name in block.reason or "one line of" in block.reason):
            script.append(block.text)
        for words in block.commands if block.language == "console" and block.how == "run" else ():
            assert main(words[1:]) == 0
    added = [line for line in script[0].splitlines() if line and "import" not in line]
    assert len(added) == 4 and added[0].startswith("cfg = load_env_cfg(")
    exec(compile("\n".join(script), PAGE.name, "exec"), {})
