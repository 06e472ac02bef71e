"""Results at a glance: what the first lines of a terminal and the first screen of a page hold."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest
from rich.table import Table

from browser import chromium
from stiction.files.joints import FRICTION_REACHES_ZERO, Estimate, Finding, JointRecord, JointsFile
from stiction.identification.verdict import judge
from stiction.report.glance import Glance, card, plus_minus, print_glance, two_digits
from stiction.report.identified import glance_of, glance_rows, identified_card
from stiction.report.page import render_page
from stiction.report.terminal import Terminal

BUTTON = "document.querySelector('.copy button')"
"""Button of the card."""

WRONG = Finding("unit", f"the torque is 2 times kp {'and so on ' * 20}", "check --torque-scale")
FAINT = Finding(FRICTION_REACHES_ZERO, "the interval reaches zero", "log for longer")


def joint(low: float, high: float, condition: str = "loaded", **more: object) -> JointRecord:
    """Return a judged knee with friction between two shares of 40 N m."""
    share = Estimate((low + high) / 2, 0.001, (low, high))
    findings = more.pop("findings", ())
    known = {"coulomb_friction": share.scaled(40.0), "friction_ratio": share, "torque_limit": 40.0} | more
    record = JointRecord(**known, test_condition=condition, findings=findings, diagnostics={"samples": 9})
    return replace(record, diagnostics={"samples": 9, "verdict": judge(record).to_dict()})


def shown(glance: Glance | None, *tables: Table, terminal: bool = True) -> list[str]:
    """Return the lines of a terminal of 80 columns, or of a file."""
    assert glance is not None
    out = io.StringIO()
    print_glance(Terminal(file=out, width=80, force_terminal=terminal, color_system=None), glance, *tables)
    return out.getvalue().splitlines()


@pytest.mark.parametrize(
    ("value", "ends", "text"),
    [
        (0.4415, (0.4388, 0.4442), "0.4415 ± 0.0027"),
        (0.44, (0.34, 0.5392), "0.44 ± 0.10"),
        (123.4, (100.0, 148.0), "123 ± 24"),
        (1234.0, (1000.0, 1480.0), "1230 ± 240"),
        (0.1, (-0.1, 0.3), "at most 0.30"),
        (-2.0, (-3.0, -1.0), "at most 0"),
        (0.5, (0.5, 0.5), "0.50"),
    ],
)
def test_an_interval_has_two_digits_and_the_estimate_the_same_place(
    value: float, ends: tuple[float, float], text: str
) -> None:
    """By hand: half of 0.0054 is 0.0027, and half of 0.1992 rounds to 0.10, a place less."""
    assert plus_minus(Estimate(value, 0.1, ends)) == text
    assert [two_digits(each) for each in (1.0, 0.981, 12.6, 1260.0, 0.0)] == ["1.0", "0.98", "13", "1300", "0"]


def test_a_joint_is_five_lines_with_the_command_alone_on_its_line() -> None:
    """Friction, answer in capitals, next command, place of the rest; none wider than the terminal."""
    lines = shown(glance_of(JointsFile({"knee": joint(0.13, 0.2)}), Path("identified")))
    assert lines == [
        "Friction 6.6 ± 1.4 N m, 16 % of 40 N m",
        "Matters: YES",
        "Next:",
        "  stiction train --friction-from identified/training.json --preset quick",
        "why, and what is not known: identified/report.html",
    ]


@pytest.mark.parametrize(
    ("record", "answer"),
    [
        (joint(0.001, 0.002), "NO"),
        (joint(0.006, 0.01), "A LITTLE"),
        (joint(0.05, 0.07), "PROBABLY"),
        (joint(0.13, 0.2), "YES"),
        (joint(-0.01, 0.04, findings=(FAINT,)), "CANNOT BE TOLD"),
        (joint(-0.01, 0.002, findings=(FAINT,)), "NO"),
        (joint(0.1, 0.2, findings=(WRONG, WRONG)), "CANNOT BE TOLD"),
        (joint(0.9, 0.95), "YES"),
        (joint(0.1, 0.2, friction_ratio=None), "CANNOT BE TOLD without --torque-limit or --kp"),
        (joint(0.1, 0.2, axis="linear"), "CANNOT BE TOLD without the task"),
    ],
)
def test_every_answer_and_refusal_has_the_same_shape(record: JointRecord, answer: str) -> None:
    """Six lines or fewer of 80 columns, no broken word; the error that changes the answer is one of them."""
    glance = glance_of(JointsFile({"knee": record}), Path("identified"))
    lines, whole = shown(glance), shown(glance, terminal=False)
    assert len(lines) <= 6 and max(map(len, lines)) <= 80, lines
    assert lines[0].startswith("Friction ") and f"Matters: {answer}" in lines
    assert sum(line.startswith("Next:") for line in lines) == 1
    assert sum(line.startswith("error") for line in lines) == (bool(record.objections) and answer != "NO")
    assert glance is not None and all(f": {text}" in "\n".join(whole) for text in glance.errors)
    words = " ".join(whole).split()
    assert all(word in [*words, "…", "error", "1", "of", "2:"] for line in lines for word in line.split()), lines


def test_of_several_joints_the_worst_comes_first_with_one_answer_and_one_command() -> None:
    """An invalid joint leads the table as an error; the answer is that of the worst valid joint."""
    records = {"hip": joint(0.001, 0.002), "knee": joint(0.13, 0.2), "toe": joint(0.1, 0.2, findings=(WRONG,))}
    refused = JointRecord(findings=(Finding("refused", "not identified: it stands", severity="warning"),))
    joints = JointsFile(records | {"heel": refused})
    lines = shown(glance_of(joints, Path("o")), Table("joint"))
    assert lines[:2] == ["Friction 6.6 ± 1.4 N m at knee, 16 % of 40 N m", "Matters: YES"]
    assert lines[2].startswith("error: toe: the torque is 2 times kp") and lines[2].endswith(" …")
    assert lines[4].startswith("note: each joint was identified as if the others stood still")
    assert lines.count("Next:") == 1 and lines[6] == "  stiction train --friction-from o/training.json --preset quick"
    assert [(row[0], row[-1]) for row in glance_rows(joints)] == [
        ("toe", "not valid"),
        ("knee", "yes"),
        ("hip", "no"),
        ("heel", "not identified"),
    ]


def test_what_the_friction_rests_on_and_the_motor_strength_are_said() -> None:
    """Positions alone give f/k, and only if the gains are as declared: the answer would mean something else without."""
    over = joint(0.05, 0.07, coulomb_friction=None, kp=20.0, combinations={"f/k": Estimate(1.0, 0.1, (0.9, 1.1))})
    lines = shown(glance_of(JointsFile({"knee": over}), Path("o")))
    assert lines[0].startswith("Friction/k 1.00 ± 0.10 N m, 6.0 % of 40 N m")
    assert "note: rests on --kp, --kd, --position-scale, which the log does not show" in lines


def test_a_file_of_an_older_version_has_no_card() -> None:
    """It has no answer, and the page shows its three lines."""
    record = replace(joint(0.05, 0.07), diagnostics={"verdict": {"lines": ["Much."]}})
    assert identified_card(JointsFile({"knee": record}), Path("o"), "") is None


def test_the_first_screen_of_the_page_has_the_answer_and_copies_the_command(tmp_path: Path) -> None:
    """At 1280 × 800 with gauge and figure, at 390 × 800 answer and command; reservations are folded; no complaint."""
    of_knee = identified_card(
        JointsFile({"knee": joint(0.05, 0.07, "in_air")}), Path("identified"), "stiction identify"
    )
    page = tmp_path / "page.html"
    page.write_text(render_page("Knee", [], "Long prose.", ["a", "b", "c", "d"], card=of_knee))
    bottoms = "[...document.querySelectorAll({!r})].map(each => each.getBoundingClientRect().bottom)"
    with chromium(tmp_path) as browser:
        for width, first in ((1280, ".answer, .copy, .card svg"), (390, ".answer, .copy")):
            tab = browser.tab("about:blank")
            sized = {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": width < 500}
            tab.call("Emulation.setDeviceMetricsOverride", **sized)
            tab.open(page.as_uri())
            tab.wait("document.querySelector('.card svg') !== null && document.readyState === 'complete'")
            ends = tab.run(bottoms.format(first))
            assert len(ends) == first.count(",") + 1 + (width == 1280) and 0 < max(ends) <= 800, ends
            assert tab.run("document.documentElement.scrollWidth") <= width
            assert (
                not tab.run("document.querySelector('.why').open")
                and tab.run("document.querySelectorAll('.why li').length") == 4
            )
            x, y, width, height = tab.run(f"Object.values({BUTTON}.getBoundingClientRect().toJSON()).slice(0, 4)")
            for kind in ("mousePressed", "mouseReleased"):
                place = {"x": x + width / 2, "y": y + height / 2, "button": "left", "clickCount": 1}
                tab.call("Input.dispatchMouseEvent", type=kind, **place)
            assert tab.wait(f"{BUTTON}.textContent !== 'Copy' && {BUTTON}.textContent") == "Copied"
            assert tab.complaints == []


def test_names_and_commands_are_text_on_the_card() -> None:
    """Names come from files; a command in an attribute of its button would be run."""
    text = card(Glance("<b>", "Matters", "no", "good", "stiction train '\"><script>'"))
    assert "<script" not in text and "&lt;b&gt;" in text and "&#34;&gt;&lt;script&gt;" in text
