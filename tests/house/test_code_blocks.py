"""Every block of code in README and documentation: it runs, or its flags exist, or it says why it cannot run here."""

from __future__ import annotations

import json
import re
import runpy
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run what documents say")

from matplotlib.textpath import TextPath

from code_blocks import MADE, Block, blocks_of, files_of
from stiction.cli.main import VERBS, main
from stiction.core import options
from stiction.joints.friction import LAWS
from stiction_experiments.lab.command import study_names

CHECKOUT = Path(__file__).parents[2]
PAGES = [
    page
    for page in (*sorted(CHECKOUT.glob("*.md")), *sorted(CHECKOUT.glob("docs/*.md")))
    if page.name != "CHANGELOG.md" and blocks_of(page)
]
NAMES = [page.relative_to(CHECKOUT).as_posix() for page in PAGES]
SHOWN = ("", "text", "csv", "math", "yaml", "json", "toml")
"""Languages of blocks in which nothing can run: each is read, where it has a form."""

pages = pytest.mark.parametrize("page", PAGES, ids=NAMES)


@pytest.fixture
def laws() -> Iterator[None]:
    """A law that a page registers is gone for the next test."""
    before = dict(LAWS)
    yield
    LAWS.clear()
    LAWS.update(before)


class Parsed(BaseException):
    """The arguments of a verb were read, and nothing else was done."""


@contextmanager
def only_parsed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let every verb end when its arguments are read."""

    def read(*_: Any, **__: Any) -> None:
        raise Parsed

    with monkeypatch.context() as patch:
        # The last step of the reader of every verb.
        patch.setattr(options, "check_effects", read)
        yield


def _where(block: Block) -> str:
    """Return where a block is, for messages."""
    return f"{block.page}:{block.line}"


def _read(words: list[str], where: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    """Fail where the parser of a verb does not know what a command says."""
    assert words[1] in VERBS, f"{where}: there is no verb {words[1]!r}"
    with only_parsed(monkeypatch):
        try:
            status = main(words[1:])
        except Parsed:
            return
        except SystemExit as error:
            status = error.code
    output = capsys.readouterr()
    assert status == 0, f"{where}: {' '.join(words)}\n{output.err or output.out}"


@pages
def test_the_flags_of_every_command_exist(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """A flag that is misspelt, or was renamed since, ends in a usage error for the stranger who copies it."""
    monkeypatch.chdir(tmp_path)
    seen = set()
    for block in blocks_of(page):
        for words in block.commands if block.language == "console" else ():
            if words[0] == "stiction" and len(words) > 1 and tuple(words) not in seen:
                seen.add(tuple(words))
                _read(words, _where(block), monkeypatch, capsys)
            if words[0] == "make":
                rule = rf"^{re.escape(words[1])}:" if len(words) > 1 else "^help:"
                assert re.search(rule, (CHECKOUT / "Makefile").read_text(), re.MULTILINE), f"{_where(block)}: {words}"


def test_every_study_that_is_named_exists() -> None:
    """A study that went leaves its name in sentences and examples of help, which no parser reads."""
    code = (path for part in ("src", "experiments") for path in (CHECKOUT / part).rglob("*.py"))
    texts = ("*.md", "docs/*.md", "experiments/*.md", "results/README.md")
    written = (path for text in texts for path in CHECKOUT.glob(text) if path.name != "CHANGELOG.md")
    for path in (*code, *written):
        named = re.findall(r"stiction study ([a-z]+)\b(?!:|\.\w)", path.read_text())
        assert {*named} <= {*study_names()}, path


@pages
def test_every_block_says_how_it_is_tested(page: Path) -> None:
    """A block that nobody runs, and that does not say why, goes stale without a word."""
    for block in blocks_of(page):
        assert block.language in (*SHOWN, "console", "python"), f"{_where(block)}: no language {block.language!r}"
        assert block.how == "run" or len(block.reason) > 5, f"{_where(block)}: say why it does not run"
        foreign = (
            [words[0] for words in block.commands if words[0] != "stiction"] if block.language == "console" else []
        )
        assert block.how == "skip" or not foreign, f"{_where(block)}: {foreign} cannot run in a test; say why"
        if block.language == "yaml":
            yaml.safe_load(block.text)
        elif block.language == "json":
            json.loads(block.text)
        elif block.language == "math":
            TextPath((0, 0), f"${block.text.strip()}$", size=10).get_extents()


@pages
@pytest.mark.usefixtures("laws", "undrawn")
def test_every_block_that_can_run_does(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """In the order of the page, in an empty folder, as somebody does who follows it."""
    running = [block for block in blocks_of(page) if block.how == "run" and block.language in ("console", "python")]
    if not running:
        pytest.skip(f"{page.name} has no block that runs")
    if any(words[1] in ("train", "export") for block in running for words in block.commands if len(words) > 1):
        pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to train")
    monkeypatch.chdir(tmp_path)
    for name in files_of(page):
        MADE[name](tmp_path / name)
    names: dict[str, Any] = {"__name__": "__page__"}
    for block in running:
        if block.language == "python":
            exec(compile(block.text, _where(block), "exec"), names)
            continue
        for words in block.commands:
            shorter = block.reduced(words)
            assert main(shorter[1:]) == 0, f"{_where(block)}: {' '.join(shorter)}\n{capsys.readouterr().err}"


@pytest.mark.usefixtures("undrawn")
def test_who_has_only_this_repository_can_type_what_the_pages_identify(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pages' log is the one that an example makes: with the flags of another its fit would not be valid."""
    example = "examples/01_log_to_verdict.py"
    monkeypatch.chdir(tmp_path)
    made = runpy.run_path(str(CHECKOUT / example))
    assert made["result"]["shank"].coulomb_friction.value == pytest.approx(0.442, rel=0.05)
    sidecar = json.loads((tmp_path / "swing.json").read_text())
    typed = [
        (_where(block), words)
        for page in PAGES
        for block in blocks_of(page)
        for words in (block.commands if block.language == "console" else ())
        if words[1:3] == ["identify", "swing.csv"]
    ]
    assert len(typed) >= 4
    for where, words in typed:
        flags = dict(zip(words[3::2], words[4::2], strict=True))
        flags.pop("--out")
        told = {name.removeprefix("--").replace("-", "_"): value for name, value in flags.items()}
        assert told == {name: f"{sidecar[name]:g}" if name in NUMBERS else sidecar[name] for name in told}, where
        assert len(told) == 5, where
    for page in ("README.md", "docs/tutorial.md", "docs/identification.md"):
        assert f"python {example}" in (CHECKOUT / page).read_text(), f"{page} does not say where swing.csv is from"


NUMBERS = ("kp", "kd", "torque_limit")
"""Numeric fields of a sidecar."""
