"""The page of the benches: what it says follows from the rows."""

from __future__ import annotations

from pathlib import Path

from stiction_experiments.bench.page import lead, report
from stiction_experiments.bench.robots import IdentifiedFriction
from stiction_experiments.lab.study import write_report

MADE = {
    "command": "stiction study bench",
    "revision": "abc",
    "machine": {"cpu": "a processor"},
    "warnings": ["Exploratory: 3."],
}


def row(robot: str, joint: str, identified: float | None) -> IdentifiedFriction:
    """Return a joint with 2 N m, an interval of ± 0.1 N m around what was found."""
    ends = (None, None) if identified is None else (identified - 0.1, identified + 0.1)
    return IdentifiedFriction(robot, "physx", "all", "0.1", 7, joint, 2.0, 0.0, 1.0, identified, *ends)


ROWS = [row("one", "FL_hip", 2.02), row("one", "FR_hip", 1.9), row("two", "FL_hip", 2.2), row("two", "FR_hip", None)]


def test_the_answer_is_counted() -> None:
    """Two of three intervals hold 2 N m; Wilson's interval of 2 of 3 is 21 to 94 %."""
    answer = lead(ROWS)
    assert answer.startswith("4 joints of 2 virtual robots, 3 of them identified: 2 intervals of 95 % hold")
    assert "(21% to 94%, every joint" in answer
    assert lead(ROWS[3:]) == "1 joints of 1 virtual robots, 0 of them identified."


def test_the_page_has_every_joint_and_the_next_step(tmp_path: Path) -> None:
    """Refused joints stand there as such."""
    steps = {"one": "stiction train --friction-from one/training.json", "two": "nothing to train for"}
    result = report(ROWS, steps, {"seconds": 3.0, "failed": {}})
    assert result.further == ["next: stiction train --friction-from one/training.json", "two: nothing to train for"]
    assert result.summary["scores"]["robots"]["two"]["identified"] == 1
    write_report(tmp_path, result, MADE)
    page = (tmp_path / "report.html").read_text()
    for text in (
        "FR_hip",
        "5.0%",
        "1.92",
        "2.12",
        "+10.0%",
        *steps.values(),
        "stiction study bench",
        "Exploratory: 3.",
    ):
        assert text in page, text
    assert (tmp_path / "bench.png").stat().st_size > 1000 and (tmp_path / "summary.json").is_file()
