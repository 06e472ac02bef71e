"""The plan of the report parses, its rows are judged, and its command goes on where it was."""

import math
import pickle
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from stiction.core.errors import TrainingError
from stiction.core.records import read_rows
from stiction.files.results import ResultRow
from stiction.learning.arguments import parse
from stiction_experiments.paper import rows as of
from stiction_experiments.paper import work
from stiction_experiments.paper.climbs import STAIRS
from stiction_experiments.paper.estimator import PARAMETERS, SAMPLED, EstimateRow
from stiction_experiments.paper.gaits import Gait
from stiction_experiments.paper.lives import Life
from stiction_experiments.paper.page import counts, judge, shares_by_training
from stiction_experiments.paper.plan import (
    FIVE,
    GAITS,
    LEVELS,
    ON_ROBOTS,
    PLACES,
    THREE,
    TRAININGS,
    UNDER_LOAD,
    WORN,
    own_robot,
)
from stiction_experiments.paper.questions import overall
from stiction_experiments.paper.results import Learning, Results
from stiction_experiments.paper.rows import Walks, walk_row
from stiction_experiments.paper.sentences import SENTENCES
from stiction_experiments.paper.study import STUDY
from stiction_experiments.paper.work import (
    Added,
    CurvePoint,
    LedgerRow,
    Step,
    curve_points,
    do_missing,
    learnings,
    missing_steps,
    steps,
)


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
                assert places[each].takes(trainings[name]) and friction in places[each].levels_of(trainings[name]), (
                    training,
                    each,
                )
                assert name == training or places[each].forward
            return {}

        def of_curve(self, training, name):
            asked.add(training)
            return {}

        def crossed(self, training, place, friction, height):
            (stairs,) = [one for one in STAIRS if one.name == place]
            assert training in stairs.trainings and friction in stairs.levels and height in stairs.heights
            return {}

        def gait(self, training, name):
            assert training in GAITS and name in Gait.__dataclass_fields__
            return {}

        def life(self, training, name):
            assert training in WORN and name in Life.__dataclass_fields__
            return {}

    for sentence in SENTENCES:
        if sentence.tests is not None:
            sentence.tests(Asked(Walks(())))
    assert asked <= set(names) and {*GAITS, *WORN, *UNDER_LOAD, *ON_ROBOTS} <= set(names)


def test_values_of_rows():
    """Ratios 1.0 and 0.6: deviation 0.2, worst 0.6, one of two followed; a fall counts as standing."""
    rows = [walk_row("none", "mujoco", "0.2", one) for one in (row("vx=0.5", 0.5, 0, 0), row("wz=1", 0, 0, 0.6))]
    assert of.deviation(rows) == pytest.approx(0.2)
    assert of.worst_reach(rows) == pytest.approx(0.6) and of.best_reach(rows) == pytest.approx(1.0)
    assert of.share_followed(rows) == 0.5 and of.flight(rows) == 0.25
    fallen = walk_row("none", "mujoco", "0.2", row("vx=0.5", 0.5, 0, 0, falls=0.1))
    assert of.worst_reach([fallen]) == 0.0 and of.fall_rate([fallen]) == pytest.approx(0.1)
    stood = walk_row("none", "mujoco", "0.2", row("stand", 0.03, 0.04, 0.0))
    assert of.planar_speed([stood]) == pytest.approx(0.05) and stood.ratios == ()
    assert of.planar_speed([stood, replace(stood, falls=0.25)]) == math.inf


def test_chatter_is_that_of_results_and_unknown_after_a_fall() -> None:
    """By physics step, 70 and 90 rad/s²; neither a fall nor a batch tells it, and then the seed does not count."""
    known, other = (replace(row("vx=0.5", 0.5, 0, 0), joint_chatter=value) for value in (70.0, 90.0))
    rows = [walk_row("none", "webots", "0", one) for one in (known, other)]
    assert of.chatter(rows) == 80.0
    assert math.isnan(of.chatter([rows[0], replace(rows[1], falls=0.1)]))
    unknown = walk_row("none", "webots", "0", row("vx=0.5", 0.5, 0, 0, seed=11))
    assert Walks([*rows, unknown]).over_places(of.chatter, "none", ("webots",), "0") == {10: 80.0}


def test_seeds_count_where_they_walked_everywhere():
    """The mean over two places is of the seed that both have."""
    cells = [("mujoco", 10, 0.5), ("physx", 10, 0.3), ("mujoco", 11, 0.5)]
    rows = [walk_row("none", place, "0.2", row("vx=0.5", speed, 0, 0, seed=seed)) for place, seed, speed in cells]
    seeds = Walks(rows).over_places(of.worst_reach, "none", ("mujoco", "physx"), "0.2")
    assert seeds == {10: pytest.approx(0.8)}


def test_a_sentence_on_learning_is_judged():
    """Areas of 0.3 against 0.2 with little scatter: friction makes training harder; what has no walk is not walked."""
    areas = [
        Learning(name, 10 + k, area + 0.001 * k * k * area)
        for name, area in (("direct", 0.3), ("none", 0.2))
        for k in range(5)
    ]
    judged = {one.number: one for one in judge(Results(Walks(()), areas))}
    assert judged["26"].outcome == "holds"
    assert judged["1"].outcome == "not walked" and judged["13"].outcome == "not testable"
    assert counts([*judged.values()]).startswith(f"Of {len(judged)} sentences ")


def test_sentences_on_lives_and_estimators_are_judged():
    """`deception` follows 0.4 more of a life; an objective without a minimum identifies nothing in ten draws."""
    lives = [
        Life(name, seed, robot, "vx=0.5", share + 0.01 * seed + 0.001 * (name == "none") * (seed % 2), 0.5)
        for name, share in (("deception", 0.5), ("none", 0.1))
        for seed in range(10, 15)
        for robot in (3000, 3001)
    ]
    estimates = [
        EstimateRow(draw, "Go1", SAMPLED, name, 0.01, None, False, 0.1, 0.0)
        for draw in range(10)
        for name in PARAMETERS
    ]
    judged = {one.number: one for one in judge(Results(Walks(()), lives=lives, estimates=estimates))}
    assert judged["27"].outcome == "holds: 5 to 30 %; undecided: 24 to 30 %"
    assert judged["12"].outcome.startswith("does not hold: I (sampled angle), B (sampled angle)")
    assert "inf (inf to inf, 10 seeds)" in judged["12"].evidence


def test_a_training_that_stands_is_told_from_one_that_walks() -> None:
    """At 0.02 m/s one stands with friction, if its like without friction, at 0.45, does not stand too."""
    walks = [
        walk_row(name, "mujoco", level, row(command, sign * speed, 0.0, 0.0, seed=seed))
        for name, level, speed in (("direct-weak", "0.2", 0.02), ("none-weak", "0", 0.45))
        for command, sign in (("vx=0.5", 1.0), ("vx=-0.5", -1.0))
        for seed in THREE
    ]
    (judged,) = [each for each in judge(Results(Walks(walks))) if each.number == "15"]
    assert judged.outcome.startswith("holds: direct-weak; not walked: direct, ")
    still = [replace(one, mean_vx=0.0) if one.training == "none-weak" else one for one in walks]
    (judged,) = [each for each in judge(Results(Walks(still))) if each.number == "15"]
    assert judged.outcome.startswith("undecided: direct-weak; not walked: direct, ")


def test_a_friction_that_begins_later_is_compared_with_one_from_the_start():
    """Ratios of 0.02, 0.04, 0.06 from the start, and of 0.78, 0.82, 0.86 where it begins later."""
    walks = [
        walk_row(name, "mujoco", "0.2", row("vx=0.5", speed + step * number, 0.0, 0.0, seed=seed))
        for name, speed, step in (("direct-half", 0.01, 0.01), ("direct-half-later", 0.39, 0.02))
        for number, seed in enumerate(THREE)
    ]
    (judged,) = [each for each in judge(Results(Walks(walks))) if each.number == "20"]
    assert judged.outcome == "holds"
    assert "0.82 (0.78 to 0.86, 3 seeds) and 0.04 (0.02 to 0.06, 3 seeds), difference +0.78 [" in judged.evidence


def test_places_of_better_overall_count_alike():
    """All of two engines and three of four robots are followed: 5 of 6, at 1 % in an engine for bench on a robot."""
    rows = [
        walk_row("none", place, friction, row("vx=0.5", 0.5 * good, 0, 0))
        for place, friction, good in (
            *(("physx", "0.01", 1), ("webots", "0.01", 1), ("robot-3000", "bench", 1)),
            *(("robot-3001", "bench", 1), ("robot-3002", "bench", 1), ("robot-3003", "bench", 0)),
        )
    ]
    assert overall(Results(Walks(rows)), "none", "bench") == {10: pytest.approx(5 / 6)}


def test_the_way_from_the_papers_training_to_ours_has_what_walked_everywhere() -> None:
    """Half of the commands under every friction is 50 %; `literal`, which lacks one, has no row."""
    walks = [
        walk_row(name, "mujoco", level, row(command, speed, 0, 0, seed=seed))
        for name, levels in (("none", LEVELS), ("literal", LEVELS[1:]))
        for level in levels
        for command, speed in (("vx=0.5", 0.5), ("vx=0.8", 0.0))
        for seed in THREE
    ]
    rows = shares_by_training(Results(Walks(walks)))
    assert rows == [{"training": "none", "seeds": "3", **dict.fromkeys(LEVELS, "50 %")}]


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
    """Motors and existing policies come first; a group trains, each seed beside the others, before it walks."""
    names = [step.name for step in steps(tmp_path)]
    cohort = [f"walk mujoco {name}" for name in ("none", "direct", "deception")]
    assert names[:4] == ["estimate", *cohort] and len(names) == len(set(names))
    assert names.index("train net-s10") < names.index("train net-three-s12") < names.index("walk mujoco net")
    assert names.index("walk mujoco net") < names.index("train stairs-none-s10")
    assert names.index("train stairs-net-s12") < names.index("walk stairs-robots stairs-net")
    assert {"walk gait go1-plain", "walk lives none", "walk lives deception"} <= {*names}
    assert "walk mujoco stairs-net" not in names and "walk robot-3000 mean-kept" not in names


def test_what_the_ledger_has_is_not_done_again(tmp_path: Path, monkeypatch) -> None:
    """On a new machine, with rows and ledger alone, no walk is repeated and no policy trained whose walks are done.

    But for those of `none`, of whose walks the nets are.
    """
    monkeypatch.chdir(tmp_path)
    every = [step.name for step in steps(tmp_path)]
    walks = {name for name in every if name.startswith("walk ") and name.endswith((" direct", " none", " mean-kept"))}
    left = [step.name for step in steps(tmp_path, walks)]
    trained = {f"train {name}-s{seed}" for name in ("direct", "mean-kept") for seed in FIVE}
    assert {*every} - {*left} == walks | trained
    assert left.index("train none-s14") < left.index("train net-s10")
    once = [step.name for step in missing_steps(tmp_path)]
    assert len(once) == len({*once}) and once[1] == "train none-s10" and {*once} == {*every}


def test_a_step_of_a_batch_can_be_sent_to_another_process(tmp_path: Path) -> None:
    """Trainings run in workers: what they need is pickled."""
    trained = [step for step in steps(tmp_path) if step.batch]
    sent = [pickle.loads(pickle.dumps(step)) for step in trained]  # noqa: S301
    assert [step.do.args for step in sent] == [step.do.args for step in trained] and len(sent) > 100


def test_what_ended_beside_a_failure_stays(tmp_path: Path, monkeypatch) -> None:
    """Rows and ledger have what ended, whichever failed; the next call does the failed one, and what lost its file.

    Of a step that had begun before, nobody knows the time.
    """
    done: list[str] = []
    broken = {"a"}

    def do(name: str, _) -> Added:
        if name in broken:
            raise TrainingError("no")
        done.append(name)
        (tmp_path / name).touch()
        return Added("curves.csv", [CurvePoint(name, 10, 10, 0.5, 0.0, 0.0)], ("training", "seed"))

    def some(out, known, jobs):
        for name in ("a", "b", "c"):
            yield Step(name, partial(do, name), out / name, out / f"{name}-begun", batch="" if name == "c" else "all")

    def go_on() -> list[str]:
        told: list[str] = []
        do_missing(tmp_path, 9, 1, told.append, lambda name, share: None)
        return told

    monkeypatch.setattr(work, "steps", some)
    with pytest.raises(TrainingError):
        go_on()
    assert done == ["b"]
    broken.clear()
    (tmp_path / "b").unlink()
    (tmp_path / "b-begun").touch()
    assert go_on() == ["a, b", "c"] and done == ["b", "a", "b", "c"] and go_on() == []
    assert sorted(point.training for point in read_rows(tmp_path / "curves.csv", CurvePoint)) == ["a", "b", "c"]
    ledger = {row.step: row.seconds for row in read_rows(tmp_path / "ledger.csv", LedgerRow)}
    assert [ledger[name] is None for name in "abc"] == [False, True, False]


def test_a_policy_that_is_there_is_not_exported_again(tmp_path: Path, monkeypatch) -> None:
    """A run that ended before its row was written would block all that follows, as nothing writes over a policy."""
    ran: list[object] = []

    def program(words, log):
        ran.append(words[0])
        folder = words[-1] if words[0] == "export" else words[words.index("--out") + 1]
        folder.mkdir(parents=True, exist_ok=True)
        (folder / ("contract.json" if words[0] == "export" else "summary.json")).touch()

    monkeypatch.setattr(work, "_program", program)
    (training,) = [each for each in TRAININGS if each.name == "mean-kept"]
    for _ in range(2):
        added = work._train(training, 10, tmp_path, lambda name, share: None)
        assert ran == ["train", "export"] and added.rows == []


def test_a_training_has_the_area_of_its_curve_and_the_time_of_its_step() -> None:
    """Areas 0.5 and 0.3 have a mean of 0.4; half of the command is reached in the second ten, or after the last."""
    curves = [CurvePoint("net", 10, 10, 0.5, 0.0, 0.0), CurvePoint("net", 10, 20, 0.3, 0.5, 0.0)]
    ledger = [LedgerRow("train net-s10", 100.0, "a"), LedgerRow("walk mujoco net", 500.0, "a")]
    (learning,) = learnings(curves, ledger)
    assert learning == Learning("net", 10, pytest.approx(0.4), 20, 100.0)
    assert learnings(curves[:1], [])[0] == Learning("net", 10, 0.5, 20, None)


def test_the_command_judges_what_a_folder_has(tmp_path: Path, capsys):
    """Without rows every sentence says so, and the page is there."""
    assert STUDY.main(["--out", str(tmp_path / "paper")], "study paper") == 0
    assert "not walked yet" in capsys.readouterr().out
    assert (tmp_path / "paper/report.html").is_file()
    from stiction_experiments.paper.page import SentenceRow

    assert len(read_rows(tmp_path / "paper/sentences.csv", SentenceRow)) == len(SENTENCES)
