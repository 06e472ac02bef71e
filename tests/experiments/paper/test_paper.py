"""The plan of the report parses, its rows are judged, and its command goes on where it was."""

from pathlib import Path

import pytest

from stiction.core.records import read_rows
from stiction.files.results import ResultRow
from stiction.learning.arguments import parse
from stiction_experiments.paper import rows as of
from stiction_experiments.paper.page import counts, judge
from stiction_experiments.paper.plan import PLACES, THREE, TRAININGS, own_robot
from stiction_experiments.paper.rows import Walks, walk_row
from stiction_experiments.paper.sentences import SENTENCES, Learning, Results
from stiction_experiments.paper.study import STUDY
from stiction_experiments.paper.work import curve_points, steps


def row(command: str, *velocity: float, falls: float = 0.0, seed: int = 10) -> ResultRow:
    """Return a row of results.csv."""
    return ResultRow(
        *("p", "none", seed, "mujoco", "coulomb", 0.2, "flat", command, None, 0.1, falls, 1.0, None, None),
        *(100.0, None, 0.25, 8),
        **dict(zip(("mean_vx", "mean_vy", "mean_wz"), velocity, strict=True)),
    )


def test_every_training_parses():
    """Each training's words are read by `stiction train`."""
    for training in TRAININGS:
        words = [word for word in training.words if word not in ("--actuator", "{net}")]
        cfg = parse(["--preset", training.preset, *words, "--seed", "10"]).config
        assert cfg.task.friction.method == words[words.index("--method") + 1]


def test_names_of_trainings_and_sentences_are_unique():
    """A training in a sentence is one of the plan, and walks in its place under its friction: none waits for ever."""
    names = [training.name for training in TRAININGS]
    trainings, places = ({each.name: each for each in listed} for listed in (TRAININGS, PLACES))
    assert len(names) == len(set(names)) and len({one.number for one in SENTENCES}) == len(SENTENCES)
    asked = set()

    class Asked(Results):
        def at(self, value, training, place, friction, *commands):
            name = training.removesuffix("+measured")
            asked.add(name)
            for each in (place,) if isinstance(place, str) else place:
                assert places[each].takes(trainings[name]) and friction in places[each].levels, (training, each)
                assert name == training or places[each].forward
            return {}

        def of_curve(self, training, name):
            asked.add(training)
            return {}

    for sentence in SENTENCES:
        if sentence.tests is not None:
            sentence.tests(Asked(Walks(())))
    assert asked <= set(names)


def test_values_of_rows():
    """Ratios 1.0 and 0.6: deviation 0.2, worst 0.6, one of two followed; a fall counts as standing."""
    rows = [walk_row("none", "mujoco", "0.2", one) for one in (row("vx=0.5", 0.5, 0, 0), row("wz=1", 0, 0, 0.6))]
    assert of.deviation(rows) == pytest.approx(0.2)
    assert of.worst_reach(rows) == pytest.approx(0.6) and of.best_reach(rows) == pytest.approx(1.0)
    assert of.share_followed(rows) == 0.5 and of.flight(rows) == 0.25
    fallen = walk_row("none", "mujoco", "0.2", row("vx=0.5", 0.5, 0, 0, falls=0.1))
    assert of.worst_reach([fallen]) == 0.0 and of.fall_rate([fallen]) == pytest.approx(0.1)
    stood = walk_row("none", "mujoco", "0.2", row("stand", 0.03, 0.04, 0.0))
    assert of.standing_speed([stood]) == pytest.approx(0.05) and stood.ratios == ()


def test_seeds_count_where_they_walked_everywhere():
    """The mean over two places is of the seed that both have."""
    cells = [("mujoco", 10, 0.5), ("physx", 10, 0.3), ("mujoco", 11, 0.5)]
    rows = [walk_row("none", place, "0.2", row("vx=0.5", speed, 0, 0, seed=seed)) for place, seed, speed in cells]
    seeds = Walks(rows).over_places(of.worst_reach, "none", ("mujoco", "physx"), "0.2")
    assert seeds == {10: pytest.approx(0.8)}


def test_a_sentence_on_learning_is_judged():
    """Areas of 0.3 against 0.2 with little scatter: friction makes training harder; what has no walk is not walked."""
    areas = [
        Learning(name, 10 + k, area + 0.001 * k * k)
        for name, area in (("direct", 0.3), ("none", 0.2))
        for k in range(5)
    ]
    judged = {one.number: one for one in judge(Results(Walks(()), areas))}
    assert judged["26"].outcome == "undecided" or judged["26"].outcome == "holds"
    assert judged["1"].outcome == "not walked" and judged["13"].outcome == "not testable"
    assert counts([*judged.values()]).startswith(f"Of {len(judged)} sentences ")


def test_curves_are_means_over_ten_iterations():
    """The last, incomplete ten are left out."""
    names = ("walk/tracking_error", "walk/forward_ratio", "walk/backward_ratio")
    metrics = [dict.fromkeys(names, float(k)) for k in range(25)]
    points = curve_points("none", 10, metrics)
    assert [(point.iteration, point.tracking_error) for point in points] == [(10, 4.5), (20, 14.5)]


def test_a_net_is_of_the_walks_that_its_name_says() -> None:
    """Twelve walks each: four backward commands or six all ways on the own robot, or four on each of three robots."""
    nets = {training.name: training for training in TRAININGS if training.net and training.walks_flat}
    assert {name: (len(each.net), each.logged) for name, each in nets.items()} == {
        "net": (4, 1),
        "net-all": (6, 1),
        "net-three": (4, 3),
    }
    assert [own_robot(seed) for seed in THREE] == [3000, 3001, 3002] and own_robot(13) == 3000


def test_steps_are_in_the_order_of_their_worth(tmp_path):
    """Existing policies walk first; a net comes before its training."""
    names = [step.name for step in steps(tmp_path)]
    assert names[0] == "walk mujoco none" and len(names) == len(set(names))
    assert names.index("net net-s10") < names.index("train net-s10") < names.index("export net-s10")


def test_the_command_judges_what_a_folder_has(tmp_path: Path, capsys):
    """Without rows every sentence says so, and the page is there."""
    assert STUDY.main(["--out", str(tmp_path / "paper")], "study paper") == 0
    assert "not walked yet" in capsys.readouterr().out
    assert (tmp_path / "paper/report.html").is_file()
    from stiction_experiments.paper.page import SentenceRow

    assert len(read_rows(tmp_path / "paper/sentences.csv", SentenceRow)) == len(SENTENCES)
