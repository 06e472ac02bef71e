"""The page of the comparison: every file, and sentences that the numbers bear."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from stiction.formats.experiment import Verdict
from stiction.formats.grid import FED
from stiction.formats.replication import BOTH, Behind, BudgetPoint, ForwardPoint, Onset, PartRecord, Replication, Sample
from stiction.formats.results import ResultRow, read_results
from stiction.formats.rows import read_rows
from stiction.report.replication import lead, warnings, write_replication
from stiction.report.replication_clips import ClipPair
from stiction.report.replication_figures import draw_needs, reach
from stiction.report.replication_methods import friction_text, place_sheets, stairs_sheet
from stiction.report.replication_tables import forward_sheet, needs_sheet

ROWS = [
    ResultRow("p", "none", 0, "physx", "coulomb", level, "flat", command, 1.0 - level, 0.1, 0.0, 4.0, None, 1.0, *rest)
    for level in (0.0, 0.1, 0.2)
    for command, rest in (("vx=0.5", (20.0, 0.8, 0.0, 8)), ("vx=-0.5", (20.0, 0.8, 0.0, 8)))
]


def details(rows: list[ResultRow]) -> list[dict]:
    """Return rows as summary.json has them."""
    return [vars(row) | {"crossed": None, "crossed_interval": None} for row in rows]


def onset(way: str, engine: str, level: float | None, *others: float) -> Onset:
    """Return where a way falls in an engine, tested up to 30 %; others: seeds beside the first."""
    seeds = [level, *others]
    each = " ".join(">0.3" if one is None else f"{one:g}" for one in seeds)
    mean = None if seeds == [None] else sum(0.3 if one is None else one for one in seeds) / len(seeds)
    return Onset(way, engine, "coulomb", len(seeds), mean, None, None, 0.3, each, None)


def sample(command: str, column: str, mean: float, engine: str = "physx", law: str = "coulomb", **more) -> Sample:
    """Return a sample of `none` at 10 %: two seeds, ± 0.1, no trials."""
    plain = Sample(
        *("none", engine, law, 0.1, "flat", command, column, "0 1", f"{mean} {mean}", mean, mean - 0.1, mean + 0.1),
        *(None, None, None),
    )
    return replace(plain, **more)


RESULT = Replication(
    parts=[PartRecord("engines", "Sim2Sim", ROWS, details(ROWS))],
    samples=[
        sample("vx=0.5", "speed_ratio", 0.9),
        sample("wz=0.5", "speed_ratio", 0.7, seeds="0", low=None, high=None),
        sample(BOTH, "fall_rate", 0.1, trials=40, trials_low=0.04, trials_high=0.23),
    ],
    budget=[BudgetPoint("none", "physx", "coulomb", lv, 1, 1 - lv, None, None, f"{1 - lv}") for lv in (0.0, 0.1, 0.2)],
    forward=[ForwardPoint(FED, "physx", "coulomb", 0.1, 1, 0.95, None, None, "0.95", 0, 0)],
    onsets=[onset("none", "physx", 0.12), onset("none", "ode", 0.08)],
    verdicts=[Verdict("E1", "a <sentence>", "a criterion", "not tested", "none 0.90 (one seed)")],
    behind=[Behind("none", "physx", "coulomb", 0.1, "flat", "vx=0.5", "E1", "speed_ratio", "0 1", "0.8 1")],
    ways={"none": "without friction"},
    summary={
        "command": "stiction replicate",
        "dead_band": 0.45,
        "grids": {"engines": {"title": "Sim2Sim"}},
        "policies": {"p": {"way": "none", "seed": 0, "revision": "abc", "digest": "0" * 64, "command": "train"}},
        "revision": "abc",
        "warnings": ["The code changed."],
        "failed": {"p-s1": "it diverged"},
        "seconds": 1.0,
        "machine": {"cpu": "a processor"},
    },
)


def test_every_file_is_written(tmp_path: Path) -> None:
    """A page without its numbers beside it could not be checked."""
    page = write_replication(tmp_path, RESULT, [])
    names = {path.name for path in tmp_path.iterdir()}
    assert names >= {
        "results.csv",
        "methods.csv",
        "budget.csv",
        "forward.csv",
        "onsets.csv",
        "verdicts.csv",
        "evidence.csv",
    }
    assert names >= {"summary.json", "tables.md"}
    assert {"budget.png", "needs.png"} <= names
    assert read_results(tmp_path / "results.csv") == ROWS
    assert json.loads((tmp_path / "summary.json").read_text())["verdicts"][0]["outcome"] == "not tested"
    html = page.read_text()
    assert "a &lt;sentence&gt;" in html
    assert "<script" not in html and 'src="http' not in html
    assert html.index("Which training does my joint need?") < html.index("a &lt;sentence&gt;")
    assert html.index("a &lt;sentence&gt;") < html.index("What E1 was judged by") < html.index("0.90 ± 0.10")
    assert read_rows(tmp_path / "methods.csv", Sample) == RESULT.samples
    assert read_rows(tmp_path / "evidence.csv", Behind) == RESULT.behind
    assert read_rows(tmp_path / "forward.csv", ForwardPoint) == RESULT.forward


def test_clips_say_in_which_simulator_they_are(tmp_path: Path) -> None:
    """A page that asks about transfer must not show the training's simulator as if it were the robot."""
    for name in ("a", "b"):
        (tmp_path / f"{name}.webp").write_bytes(b"RIFF")
    pair = ClipPair("none", "p", tmp_path / "a.webp", tmp_path / "b.webp")
    html = write_replication(tmp_path, RESULT, [pair]).read_text()
    assert html.index("none (p): MuJoCo, the simulator of the training") < html.index("none (p): virtual robot, PhysX")
    html = write_replication(tmp_path, RESULT, [replace(pair, robot=None)]).read_text()
    assert "these clips do not show transfer" in html and "virtual robot, PhysX" not in html


def needs(onsets: Sequence[Onset]) -> dict[str, tuple[str, str]]:
    """Return friction -> who follows, and who does on average only."""
    return {friction: (follows, average) for friction, follows, average in needs_sheet(onsets).rows}


def test_a_way_follows_only_if_it_does_in_every_engine() -> None:
    """At 10 % it is above its onset in ODE, and below in PhysX."""
    assert needs(RESULT.onsets)["5 %"] == ("none (one seed)", "–")
    assert needs(RESULT.onsets)["10 %"] == ("none of them", "–")


def test_what_was_not_tested_is_not_said_to_fail() -> None:
    """Nobody was walked at 30 % where levels end at 20 %."""
    short = [replace(onset("none", "physx", None), tested=0.2)]
    assert needs(short)["20 %"] == ("none (one seed)", "–")
    assert needs(short)["25 %"] == ("not tested", "–")


def test_a_place_that_was_tested_less_refutes_nobody() -> None:
    """At 25 % one way was tested in one engine of two, and another fell before: neither is said of the other."""
    less = [onset("deception", "physx", None), replace(onset("deception", "ode", None), tested=0.2, each=">0.2")]
    assert needs(less)["20 %"] == ("deception (one seed)", "–")
    assert needs(less)["25 %"] == ("deception (one seed, not tested in ode)", "–")
    fallen = onset("none", "physx", 0.12)
    assert needs([fallen, less[1]])["25 %"] == ("none of those tested", "–")
    assert needs([fallen])["25 %"] == ("none of them", "–")


def test_friction_alone_limits_nobody() -> None:
    """The cell by which causes are told apart is no robot: its levels end sooner, and its onset is no user's."""
    causes = [replace(onset("deception", "physx+friction", None), tested=0.2), onset("none", "physx+friction", 0.03)]
    whole = [onset("deception", "physx+all", 0.27), onset("none", "physx+all", 0.06)]
    assert needs([*whole, *causes])["25 %"] == ("deception (one seed)", "–")
    assert needs([*whole, *causes])["5 %"] == ("deception (one seed), none (one seed)", "–")
    assert reach([whole[0], causes[0]]) == (0.27, True)
    assert reach(causes) is None


def test_a_bar_ends_at_an_onset_and_is_hollow_where_there_is_none() -> None:
    """The end of testing is no failure: 24 % where one engine was walked to 20 % alone, and at least 30 % without."""
    fell, short = onset("direct", "physx", 0.24), replace(onset("direct", "ode", None), tested=0.2)
    alive = [replace(one, method="deception") for one in (short, onset("direct", "physx", None))]
    assert reach([fell, short]) == (0.24, True)
    assert reach(alive) == (0.3, False)
    mixed = onset("point", "physx", None, 0.1)
    (axis,) = draw_needs([fell, short, *alive, mixed], ["direct", "deception", "point"]).axes
    assert [bar.get_width() for bar in axis.patches] == pytest.approx([24.0, 30.0, 20.0])
    assert [bar.get_facecolor()[-1] for bar in axis.patches] == [0.35, 0.0, 0.35]
    marks = axis.get_lines()[:5]
    assert [mark.get_xdata()[0] for mark in marks] == pytest.approx([24.0, 20.0, 20.0, 30.0, 20.0])
    assert [mark.get_fillstyle() for mark in marks] == ["full", "none", "none", "none", "left"]


def test_seeds_above_and_below_follow_on_average_only() -> None:
    """One stays above to 30 %, one falls at 8 %: their mean, 19 %, is no seed's."""
    mixed = [onset("direct", "physx", None, 0.08), onset("deception", "physx", None, 0.28)]
    assert needs(mixed)["5 %"] == ("direct, deception", "–")
    assert needs(mixed)["15 %"] == ("deception", "direct")
    assert needs(mixed)["20 %"] == ("deception", "–")


def test_a_missing_method_and_a_single_seed_are_said() -> None:
    """The paper compares three methods."""
    assert any("actuator, deception" in text for text in warnings(RESULT))
    assert warnings(RESULT)[:2] == ["The code changed.", "Not trained, and left out: p-s1. it diverged"]
    assert lead(RESULT).startswith("Of 1 sentences and explanations: 1 not tested.")
    stairs = replace(RESULT.samples[0], terrain="stairs=0.1", seeds="0")
    assert any(
        "no verdict: none on stairs." in text for text in warnings(replace(RESULT, samples=[stairs, *RESULT.samples]))
    )
    alone = replace(RESULT, samples=[replace(one, seeds="0") for one in RESULT.samples])
    assert lead(alone).startswith("One training seed a way: numbers, no verdicts. A verdict takes")
    assert not any("no verdict" in text for text in warnings(alone))


def test_a_part_that_was_not_walked_now_is_named() -> None:
    """Its rows may be older than the rest of the report."""
    kept = replace(RESULT, parts=[replace(RESULT.parts[0], kept="not asked for: 6 of 8 rows")])
    assert any("Sim2Sim (not asked for: 6 of 8 rows)" in text for text in warnings(kept))


def test_a_table_has_every_command_with_its_intervals() -> None:
    """Means alone would hide that one seed is no sample, and that few walks tell little about falls."""
    (sheet,) = place_sheets(RESULT.samples)
    assert sheet.title == "Sim2Sim: PhysX"
    assert sheet.header == ("friction", "method", "seeds", "forward", "turn", "falls")
    assert sheet.rows == (("10 %", "none", "one or 2", "0.90 ± 0.10", "0.70", "10% ± 10% (4% to 23%)"),)


def test_a_virtual_robot_has_its_bench_levels_in_one_table() -> None:
    """Friction of the bench, with load, and of the torque limit are levels of the same robot."""
    laws = ("real-bench+load0.02", "real", "real-bench")
    samples = [sample("vx=0.5", "speed_ratio", 0.9, "physx+all", law) for law in laws]
    samples += [sample("vx=0.5", "speed_ratio", 0.9, "mujoco", law) for law in ("coulomb", "load")]
    sheets = {sheet.title: [row[0] for row in sheet.rows] for sheet in place_sheets(samples)}
    assert sheets["The virtual robot"] == ["10 %", "bench (10 %)", "bench (10 %) and 0.02 of the load"]
    assert sheets["MuJoCo, the simulator of the training"] == ["10 %"]
    assert sheets["MuJoCo, the simulator of the training, friction by the law load"] == ["c = 0.1"]
    assert friction_text("real-bench", 0.010683) == "bench (1.07 %)"


def test_friction_fed_forward_stands_beside_what_it_replaces() -> None:
    """At the bench's value as at any other; where nothing was fed forward there is no table."""

    def point(way: str, ratio: float) -> ForwardPoint:
        return ForwardPoint(way, "physx+all", "real-bench", 0.0107, 3, ratio, ratio - 0.1, ratio + 0.1, "", 6, 2)

    sheet = forward_sheet([point("none", 0.7), point(FED, 0.95)], virtual=True)
    assert sheet is not None
    assert sheet.rows == (("physx+all", "bench (1.07 %)", "6 of 8", "0.70 ± 0.10 (3)", "0.95 ± 0.10 (3)", "–"),)
    assert forward_sheet([point("none", 0.7), point(FED, 0.95)], virtual=False) is None
    assert forward_sheet([], virtual=True) is None


def test_no_stairs_no_table() -> None:
    """A table of dashes would read as failures."""
    assert stairs_sheet(RESULT.samples) is None


def test_stairs_have_both_intervals() -> None:
    """Of the seeds, and of the crossings."""
    crossed = sample("vx=0.4", "crossed", 0.9, terrain="stairs=0.08", trials=40, trials_low=0.77, trials_high=0.96)
    sheet = stairs_sheet(
        [crossed, replace(crossed, column="steps_climbed", mean=11.5, trials_low=None, low=11.0, high=12.0)]
    )
    assert sheet is not None
    assert sheet.rows == (("none", "physx", "10 %", "stairs=0.08", "2", "40", "90% ± 10% (77% to 96%)", "11.5 ± 0.5"),)
