"""The page of the comparison: every file, and sentences that the numbers bear."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from stiction.core.records import read_rows
from stiction.evaluation.policies import FED
from stiction.evaluation.table import BOTH, Sample
from stiction.files.results import ResultRow, read_results
from stiction.report.following import friction_text
from stiction_experiments.lab.claims import Verdict
from stiction_experiments.lab.following import recommended_sentence, recommended_sheet
from stiction_experiments.lab.straight import Following, following
from stiction_experiments.lab.study import write_report
from stiction_experiments.replication.page import (
    engine_sheets,
    forward_sheet,
    lead,
    onset_sheet,
    report,
    stairs_sheet,
    warnings,
)
from stiction_experiments.replication.records import (
    BudgetPoint,
    EvidenceRow,
    ForwardPoint,
    Onset,
    PartRecord,
    Replication,
)

ROWS = [
    ResultRow("p", "none", 0, "physx", "coulomb", level, "flat", command, 1.0 - level, 0.1, 0.0, 4.0, None, 1.0, *rest)
    for level in (0.0, 0.1, 0.2)
    for command, rest in (("vx=0.5", (20.0, 0.8, 0.0, 8)), ("vx=-0.5", (20.0, 0.8, 0.0, 8)))
]


def details(rows: list[ResultRow]) -> list[dict]:
    """Return rows as summary.json has them."""
    return [vars(row) | {"crossed": None, "crossed_interval": None} for row in rows]


def onset(method: str, engine: str, level: float | None, *others: float) -> Onset:
    """Return where a method falls in an engine, tested up to 30 %; others: seeds beside the first."""
    seeds = [level, *others]
    each = " ".join(">0.3" if one is None else f"{one:g}" for one in seeds)
    mean = None if seeds == [None] else sum(0.3 if one is None else one for one in seeds) / len(seeds)
    return Onset(method, engine, "coulomb", len(seeds), mean, None, None, 0.3, each, None)


def sample(command: str, column: str, mean: float, engine: str = "physx", law: str = "coulomb", **more) -> Sample:
    """Return a sample of `none` at 10 %: two seeds, ± 0.1, no trials."""
    plain = Sample(
        *("none", engine, law, 0.1, "flat", command, column, "0 1", f"{mean} {mean}", mean, mean - 0.1, mean + 0.1),
        *(None, None, None),
    )
    return replace(plain, **more)


RESULT = Replication(
    parts=[PartRecord("engines", "Sim2Sim", details(ROWS))],
    samples=[
        sample("vx=0.5", "speed_ratio", 0.9),
        sample("wz=0.5", "speed_ratio", 0.7, seeds="0", low=None, high=None),
        sample(BOTH, "fall_rate", 0.1, trials=40, trials_low=0.04, trials_high=0.23),
    ],
    budget=[BudgetPoint("none", "physx", "coulomb", lv, 1, 1 - lv, None, None, f"{1 - lv}") for lv in (0.0, 0.1, 0.2)],
    forward=[ForwardPoint(FED, "physx", "coulomb", 0.1, 1, 0.95, None, None, "0.95", 0, 0)],
    onsets=[onset("none", "physx", 0.12), onset("none", "ode", 0.08)],
    following=following(ROWS, lambda row: row.method),
    verdicts=[Verdict("E1", "a <sentence>", "a criterion", "not tested", "none 0.90 (one seed)")],
    evidence=[EvidenceRow("none", "physx", "coulomb", 0.1, "flat", "vx=0.5", "E1", "speed_ratio", "0 1", "0.8 1")],
    methods={"none": "without friction"},
    summary={
        "dead_band": 0.45,
        "grids": {"engines": {"title": "Sim2Sim"}},
        "policies": {"p": {"way": "none", "seed": 0, "revision": "abc", "digest": "0" * 64, "command": "train"}},
        "failed": {"p-s1": "it diverged"},
        "seconds": 1.0,
    },
)
MADE = {"command": "stiction replicate", "revision": "abc", "machine": {"cpu": "a processor"}}


def written(out: Path, result: Replication) -> str:
    """Write the comparison; return its page."""
    write_report(out, report(result), MADE | {"warnings": ["The code changed."]})
    return (out / "report.html").read_text()


def test_every_file_is_written(tmp_path: Path) -> None:
    """A page without its numbers beside it could not be checked."""
    html = written(tmp_path, RESULT)
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
    assert "a &lt;sentence&gt;" in html
    assert "<script" not in html and 'src="http' not in html
    assert html.index("Which training does my joint need?") < html.index("a &lt;sentence&gt;")
    assert html.index("a &lt;sentence&gt;") < html.index('<details id="E1">') < html.index("0.90 ± 0.10")
    assert read_rows(tmp_path / "methods.csv", Sample) == RESULT.samples
    assert read_rows(tmp_path / "evidence.csv", EvidenceRow) == RESULT.evidence
    assert read_rows(tmp_path / "forward.csv", ForwardPoint) == RESULT.forward


def cell(
    method: str, engine: str, level: float, follow: int, slow: int = 0, fast: int = 0, seeds: int = 3
) -> Following:
    """Return who follows of one way at one spot."""
    return Following(method, engine, "coulomb", level, seeds, follow, slow, fast, 0, 0.1, "")


def needs(cells: Sequence[Following]) -> dict[str, dict[str, str]]:
    """Return friction -> who follows everywhere, and the counts of each method."""
    sheet = recommended_sheet(cells)
    return {row[0]: dict(zip(sheet.header[1:], row[1:], strict=True)) for row in sheet.rows}


def test_a_way_follows_only_if_every_seed_does_in_every_engine() -> None:
    """Two of three in ODE are not all; what is wrong with the third is said, and one seed is called one."""
    both = [cell("none", "physx", 0.01, 3), cell("none", "ode", 0.01, 2, fast=1)]
    assert needs(both)["1 %"] == {"every seed, everywhere": "nobody", "none": "5 of 6, 1 too fast"}
    sure = needs([both[0], cell("none", "ode", 0.01, 3)])
    assert sure["1 %"] == {"every seed, everywhere": "none", "none": "6 of 6"}
    alone = needs([cell("direct", "physx", 0.2, 1, seeds=1)])
    assert alone["20 %"] == {"its one seed, everywhere": "direct (one seed)", "direct (one seed)": "1 of 1"}


def test_one_seed_is_not_every_seed() -> None:
    """A method that was trained once follows with its one seed, beside one that does with each of three."""
    one, three = cell("direct", "physx", 0.2, 1, seeds=1), cell("none", "physx", 0.2, 3)
    assert "friction, direct follows everywhere with its one seed; " in recommended_sentence([one], 0.2)
    both = recommended_sentence([one, three], 0.2)
    assert "none follows everywhere with every seed, and direct follows everywhere with its one seed; " in both
    slow = cell("direct", "physx", 0.2, 0, slow=1, seeds=1)
    assert "no training follows everywhere with its one seed" in recommended_sentence([slow], 0.2)
    assert "no training follows everywhere with every seed" in recommended_sentence(
        [slow, cell("none", "physx", 0.2, 2, slow=1)], 0.2
    )


def test_friction_alone_and_coefficients_are_no_user_s() -> None:
    """The cell by which causes are told apart is no robot, and a coefficient is not known of a joint."""
    rows = [cell("none", "physx+friction", 0.1, 3), cell("none", "physx+all", 0.1, 0, slow=3)]
    load = replace(rows[1], friction_law="load", engine="mujoco")
    needs = replace(RESULT, following=[*rows, load]).needs
    assert needs == (rows[1],)


def test_an_onset_is_in_the_units_of_its_law() -> None:
    """Per cent of the torque limit beside a coefficient: a number without either would be read as the other."""
    shares, coefficient = (
        onset("none", "physx", 0.12, None),
        replace(onset("none", "mujoco", 0.05), friction_law="load"),
    )
    rows = onset_sheet([replace(shares, low=-0.1, high=0.4), coefficient]).rows
    assert rows[0][3:5] == ("21 %", "0 % to 40 %") and rows[0][-1] == "12 %, over 30 %"
    assert rows[1][3] == rows[1][-1] == "c = 0.05"


def test_a_verdict_that_changed_says_what_was_asked_before(tmp_path: Path) -> None:
    """Whoever read the page before must find why it says otherwise now, and that the rows are the same."""
    change = {"id": "E1", "before": "undecided", "asked_before": "80 %", "now": "not tested", "asked": "both ways"}
    judged = {"command": "stiction replicate --judge-again", "revision": "def"}
    told = replace(RESULT, summary=RESULT.summary | {"changed": [change], "judged": judged})
    html = written(tmp_path, told)
    assert (
        "Verdicts that changed with the definition of following" in html and "stiction replicate --judge-again" in html
    )
    assert "| “a <sentence>” | undecided | 80 % | not tested | both ways |" in (tmp_path / "tables.md").read_text()
    again = replace(RESULT, summary=RESULT.summary | {"changed": []})
    assert "Verdicts that changed" not in written(tmp_path, again)


def test_a_missing_method_and_a_single_seed_are_said() -> None:
    """The paper compares three methods."""
    assert any("actuator-output, deception" in text for text in warnings(RESULT))
    assert warnings(RESULT)[0] == "Not trained, and left out: p-s1. it diverged"
    assert lead(RESULT).endswith("\nOf 1 sentences and explanations of the paper, 1 was not tested.")
    stairs = replace(RESULT.samples[0], terrain="stairs=0.1", seeds="0")
    assert any(
        "no verdict: none on stairs." in text for text in warnings(replace(RESULT, samples=[stairs, *RESULT.samples]))
    )
    alone = replace(RESULT, samples=[replace(one, seeds="0") for one in RESULT.samples])
    assert lead(alone).startswith("One training seed a method: numbers, no verdicts. A verdict takes")
    assert not any("no verdict" in text for text in warnings(alone))


def test_a_table_has_every_command_with_its_intervals() -> None:
    """Means alone would hide that one seed is no sample, and that few walks tell little about falls."""
    (sheet,) = engine_sheets(RESULT.samples)
    assert sheet.title == "Sim2Sim: PhysX"
    assert sheet.header == ("friction", "method", "seeds", "forward [1]", "turn [1]", "falls [% of walks]")
    assert sheet.rows == (("10 %", "none", "one or 2", "0.90 ± 0.10", "0.70", "10% ± 10% (4% to 23%)"),)


def test_a_virtual_robot_has_its_bench_levels_in_one_table() -> None:
    """Friction of the bench, with load, and of the torque limit are levels of the same robot."""
    laws = ("real-bench+load0.02", "real", "real-bench")
    samples = [sample("vx=0.5", "speed_ratio", 0.9, "physx+all", law) for law in laws]
    samples += [sample("vx=0.5", "speed_ratio", 0.9, "mujoco", law) for law in ("coulomb", "load")]
    sheets = {sheet.title: [row[0] for row in sheet.rows] for sheet in engine_sheets(samples)}
    assert sheets["The virtual robot"] == ["10 %", "bench (10 %)", "bench (10 %) and 0.02 of the load"]
    assert sheets["MuJoCo, the simulator of the training"] == ["10 %"]
    assert sheets["MuJoCo, the simulator of the training, friction by the law load"] == ["c = 0.1"]
    assert friction_text("real-bench", 0.010683) == "bench (1.07 %)"


def test_friction_fed_forward_stands_beside_what_it_replaces() -> None:
    """At the bench's value as at any other; where nothing was fed forward there is no table."""

    def point(method: str, ratio: float) -> ForwardPoint:
        return ForwardPoint(method, "physx+all", "real-bench", 0.0107, 3, ratio, ratio - 0.1, ratio + 0.1, "", 6, 2)

    sheet = forward_sheet([point("none", 0.7), point(FED, 0.95)], virtual=True)
    assert sheet is not None
    assert sheet.rows == (("physx+all", "bench (1.07 %)", "6 of 8", "0.70 ± 0.10 (3)", "0.95 ± 0.10 (3)", "–"),)
    assert forward_sheet([point("none", 0.7), point(FED, 0.95)], virtual=False) is None
    assert forward_sheet([], virtual=True) is None


def test_stairs_have_both_intervals() -> None:
    """Shows the interval over seeds and that over crossings."""
    crossed = sample("vx=0.4", "crossed", 0.9, terrain="stairs=0.08", trials=40, trials_low=0.77, trials_high=0.96)
    sheet = stairs_sheet(
        [crossed, replace(crossed, column="steps_climbed", mean=11.5, trials_low=None, low=11.0, high=12.0)]
    )
    assert sheet is not None
    assert sheet.rows == (("none", "physx", "10 %", "stairs=0.08", "2", "40", "90% ± 10% (77% to 96%)", "11.5 ± 0.5"),)
