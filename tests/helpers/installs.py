"""Commands that each kind of installation promises: README's, and every verb with short settings."""

from __future__ import annotations

import re
from pathlib import Path

from code_blocks import MADE, Block, blocks_of, files_of
from stiction.cli.main import NEEDS

README = Path(__file__).parents[2] / "README.md"

INSTALLS = ("", "sim", "train")
"""Extras of the three installs; each has what the one before has."""

POLICY = "saturn_lite-flat-deception-0.2"
SHORT_WALKS = "--episodes 1 --seconds 3"
LOGGED = "--commands vx=0.5 --log logs --log-robots 2 --log-seconds 1"

VERBS = {
    "": (
        "list",
        "excite --duration 4 --rate 50 --torque-limit 45 --fixed-gains",
        "convert shank/joints.json --to mujoco",
        "convert training.json --to isaaclab --robot go2",
        f"verify {POLICY}",
        f"export {POLICY} --to rl_sar",
    ),
    "sim": (
        "robot show go2",
        f"demo --bundles {POLICY} {SHORT_WALKS}",
        f"evaluate {POLICY} --friction-levels 0.2 {SHORT_WALKS} {LOGGED}",
        f"identify walk logs/{POLICY}--0.2--vx=0.5--0.npz --out walked",
        f"export {POLICY} --to webots",
        f"deploy {POLICY} --robot virtual --armed --stand --duration 0.5 "
        "--stale 5 --silence 5 --gap 5 --set safety.losses=1",
    ),
    "train": (
        "train-actuator logs --epochs 1 --hidden 4",
        "study paper --help",
        "bench --num-envs 4 --blocks 1",
        "doctor",
    ),
}
"""Extra -> commands that need it. Each finds what those before it left in the folder."""


def make_files(folder: Path) -> None:
    """Write the files of one's own that the commands read."""
    for name in (*files_of(README), "training.json"):
        MADE[name](folder / name)


def extra_for(block: Block) -> str:
    """Return the extra that a block of README needs: that of its most demanding verb, or function of `stiction`."""
    called = re.findall(r"\bstiction\.(\w+)\(", block.text)
    verbs = [words[1] for words in block.commands] if block.language == "console" else called
    return max((NEEDS.get(verb, "") for verb in verbs), key=INSTALLS.index)


def promised(extra: str) -> list[list[str]]:
    """Return the commands that an install with an extra promises, as words, `stiction` or `python` first."""
    here = INSTALLS[: INSTALLS.index(extra) + 1]
    commands: list[list[str]] = []
    for block in blocks_of(README):
        if block.how == "run" and block.language in ("console", "python") and extra_for(block) in here:
            script = [["python", "-c", block.text]]
            commands += script if block.language == "python" else [block.reduced(words) for words in block.commands]
    return commands + [["stiction", *text.split()] for name in here for text in VERBS[name]]
