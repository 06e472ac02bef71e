"""Output of long commands in a terminal of 80 × 24."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to walk")

from code_blocks import MADE
from installs import POLICY, SHORT_WALKS
from processes import stiction
from terminal import Screen, run_in_terminal

IDENTIFY = "identify swing.csv --kp 20 --kd 1 --torque-limit 45 --torque-source motor_side --out shank"
EVALUATE = f"evaluate {POLICY} --friction-levels 0 --commands vx=0.5 {SHORT_WALKS} --out walks"
DEMO = f"demo --bundles {POLICY} {SHORT_WALKS} --out demo"
PHASE = "--{0}.iterations 2 --{0}.steps 4 --{0}.mini-batches 2"
TRAIN = " ".join(
    (
        "train --robot go1 --preset two-phase --method none --num-envs 4 --video-every 0 --out run",
        *(PHASE.format(phase) for phase in ("teacher", "student")),
    )
)

BAR = re.compile("^[^┏┡╇]*[━╸╺]{3}")
"""Begin of a line with a progress bar, and of no table."""

DONE = r"{} +━{{40}} \d:\d\d:\d\d 0:00:00"
"""Line of a piece of work that is done."""


@pytest.mark.parametrize(
    ("command", "bars", "first", "last"),
    [
        pytest.param(IDENTIFY, [], "Friction 0.", "shank/report.html", id="identify"),
        pytest.param(EVALUATE, [DONE.format("mujoco")], "Follows: ", "walks/report.html", id="evaluate"),
        pytest.param(
            TRAIN,
            ["teacher +━{40} 2/2", "student +━{40} 2/2"],
            "teacher ",
            "next: stiction export run",
            id="train",
            marks=pytest.mark.slow,
        ),
        pytest.param(DEMO, [DONE.format("mujoco")], "", "demo/report.html", id="demo", marks=pytest.mark.slow),
    ],
)
def test_progress_leaves_whole_lines_and_the_result(
    command: str, bars: list[str], first: str, last: str, tmp_path: Path
) -> None:
    """No control sequence is shown, each bar ends complete on a line of its own, and the result comes last."""
    if command == TRAIN:
        pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to train")
    MADE["swing.csv"](tmp_path / "swing.csv")
    status, screen = run_in_terminal(stiction(*command.split()), tmp_path)
    shown = "\n".join(screen.lines)
    assert status == 0, shown
    assert not re.search(r"\\u00|\\x|\\r|\[\??\d+[A-Za-z]", shown), shown
    drawn = [line for line in screen.lines if BAR.match(line)]
    assert len(drawn) == len(bars) and all(map(re.fullmatch, bars, drawn)), shown
    assert any(line.startswith(first) for line in screen.lines) and "".join(screen.lines).endswith(last), shown
    assert screen.cursor_shown and screen.column == 0


ABOVE = """
import sys
from stiction.cli.process import begin
from stiction.report.terminal import work_progress

if sys.argv[1:]:
    sys.stdout = open(sys.argv[1], "w", encoding="utf-8")
begin()
with work_progress() as report:
    report("walks", 0.5)
    print("warning of \\x1b[31mfile\\x1b[2J", file=sys.stderr)
    print("result \\x1b]0;title\\x07")
    report("walks", 1.0)
"""


@pytest.mark.parametrize("to_file", [False, True])
def test_text_during_a_display_stands_above_it_escaped(to_file: bool, tmp_path: Path) -> None:
    """Names from files steer no terminal, and standard output that is a file gets what is printed to it."""
    out = tmp_path / "out.txt"
    status, screen = run_in_terminal([sys.executable, "-c", ABOVE, *([str(out)] if to_file else [])], tmp_path)
    warning, result = "warning of \\u001b[31mfile\\u001b[2J", "result \\u001b]0;title\\u0007"
    *above, bar = screen.lines
    assert status == 0 and re.fullmatch(DONE.format("walks"), bar)
    assert above == ([warning] if to_file else [warning, result])
    assert not to_file or out.read_text(encoding="utf-8") == f"{result}\n"


def test_the_screen_draws_as_a_terminal_does() -> None:
    """Wraps at the last column, scrolls, goes up and erases; a sequence in two pieces is one."""
    screen = Screen(columns=4, rows=2)
    screen.feed("abcde\r\nfg\x1b[1")
    assert screen.lines == ["abcd", "e", "fg"]
    screen.feed("A\r\x1b[2Kx\n\x1b[1Cz")
    assert screen.lines == ["abcd", "x", "fgz"]
    with pytest.raises(ValueError, match="unknown sequence"):
        screen.feed("\x1b[5q")
