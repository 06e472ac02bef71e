"""The fenced blocks of the documents, what is said of running them, and the files that their commands read.

A comment before a block says how it is tested, in one line:

    <!-- test: evaluate += --episodes 1; train += --num-envs 4 -->   its commands run with these words appended
    <!-- test: parse REASON -->     its commands are read by the real parser and do nothing, because of the reason
    <!-- test: skip REASON -->      nothing of it can run here; commands of ours are still read by the parser

Without one it runs as it is. A comment at the top of a page, `<!-- files: swing.csv -->`, names what is there before.
"""

from __future__ import annotations

import hashlib
import re
import shlex
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import foreign
import robot_files
from stiction.files.bundle import shipped_bundles
from stiction.files.joints import Estimate, JointRecord, JointsFile, write_training
from stiction.files.log import LogSetup, write_log
from stiction.identification.example import LEG, example_log
from stiction.identification.verdict import propose

BLOCK = re.compile(r"^( *)```(\w*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
MARK = re.compile(r"<!-- test: ((?:(?!-->).)*) -->\s*$", re.DOTALL)
FILES = re.compile(r"^<!-- files: (.*?) -->$", re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """One fenced block of a page."""

    page: str
    """Name of the page."""
    line: int
    """First line."""
    language: str
    """Language named after the opening fence."""
    text: str
    """Content."""
    how: str = "run"
    """`run`, `parse` or `skip`."""
    reason: str = ""
    """Why it does not run."""
    more: tuple[tuple[str, tuple[str, ...]], ...] = ()
    """Verb -> words that are appended to its commands."""

    @property
    def commands(self) -> list[list[str]]:
        """Return the commands of a block of the console, each as words, without what was appended for the test."""
        lines = self.text.replace("\\\n", " ").splitlines()
        shown = (line.removeprefix("$ ") for line in lines)
        return [words for line in shown if (words := shlex.split(line, comments=True))]

    def reduced(self, words: list[str]) -> list[str]:
        """Return a command with what the test appends to it; an option that is said again takes the place of itself."""
        appended = list(dict(self.more).get(words[1], ()))
        taken = {word for word in appended if word.startswith("--")}
        kept: list[str] = []
        dropping = False
        for word in words:
            dropping = word in taken or (dropping and not word.startswith("--"))
            kept += [] if dropping else [word]
        return [*kept, *appended]


def _marked(block: Block, mark: str) -> Block:
    """Return a block as its comment says."""
    how, _, rest = mark.partition(" ")
    if how in ("parse", "skip"):
        return replace(block, how=how, reason=rest.strip())
    parts = [part.partition("+=") for part in mark.split(";")]
    assert all(sign for _, sign, _ in parts), f"{block.page}:{block.line}: no such test: {mark}"
    return replace(block, more=tuple((verb.strip(), tuple(shlex.split(words))) for verb, _, words in parts))


def blocks_of(page: Path) -> list[Block]:
    """Return the blocks of a page in their order."""
    text, blocks = page.read_text(encoding="utf-8"), []
    for match in BLOCK.finditer(text):
        indent, language, body = match.groups()
        inner = re.sub(f"^{indent}", "", body, flags=re.MULTILINE)
        block = Block(page.name, text[: match.start()].count("\n") + 1, language, inner)
        mark = MARK.search(text[: match.start()])
        blocks.append(_marked(block, " ".join(mark[1].split())) if mark else block)
    return blocks


def files_of(page: Path) -> list[str]:
    """Return the files that a page's commands find."""
    return [name for line in FILES.findall(page.read_text(encoding="utf-8")) for name in line.split()]


def _swing(path: Path) -> None:
    """Write the log that the first example makes, without the sidecar that would say what the pages' flags say."""
    write_log(path, replace(example_log(LEG, seed=1), setup=LogSetup()))


def _robot(path: Path) -> None:
    """Write a quadruped and its robot.yaml."""
    robot_files.write(path.parent)


def _policy(path: Path) -> None:
    """Write a network of somebody else, and what its maker says of it, as policy.yaml."""
    path.write_bytes(foreign.network(63, metadata=foreign.MJLAB))
    path.with_suffix(".yaml").write_text("control_period: 0.02\naction_clip: none\n")


def _model(path: Path) -> None:
    """Write a model of MuJoCo with one joint, of the log's name."""
    path.write_text('<mujoco><worldbody><body><joint name="shank"/><geom size="1"/></body></worldbody></mujoco>')


def _proposal(path: Path) -> None:
    """Write what a joint with 10 % of friction is to be trained with."""
    level = Estimate(0.1, 0.01, (0.08, 0.12))
    record = JointRecord(coulomb_friction=level, friction_ratio=level, test_condition="loaded")
    write_training(path, propose(JointsFile({"shank": record})))


def _bundle(path: Path) -> None:
    """Copy a shipped bundle."""
    shutil.copytree(shipped_bundles()["saturn_lite-flat-deception-0.2"], path)


def _joints(path: Path) -> None:
    """Write an identification of each kind of joint of a quadruped, 0.5 N m."""
    friction = JointRecord(coulomb_friction=Estimate(0.5, 0.01, (0.48, 0.52)), test_condition="in_air")
    JointsFile(dict.fromkeys(("hip", "thigh", "calf"), friction)).write(path)


def _allowed(path: Path) -> None:
    """Write the digest of every shipped bundle, and of the copy of one, as a list of those that may run."""
    sums = [(folder / "SHA256SUMS").read_bytes() for folder in shipped_bundles().values()]
    path.write_text("".join(f"{hashlib.sha256(one).hexdigest()}\n" for one in sums))


MADE: dict[str, Callable[[Path], None]] = {
    "swing.csv": _swing,
    "robot.yaml": _robot,
    "policy.onnx": _policy,
    "shank.xml": _model,
    "training.json": _proposal,
    "deception": _bundle,
    "joints.json": _joints,
    "allowed.txt": _allowed,
}
"""File -> what makes it."""
