"""Estimators of others on records whose truth is known, and the judge that is the same for all."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from importlib import util
from pathlib import Path

import numpy as np
import pytest

from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.identification.example import SATURN_LITE, SensorNoise, example_log
from stiction.identification.setup import IdentifySetup
from stiction.joints.simulate import simulate
from stiction_experiments.peers import plain, records, study
from stiction_experiments.peers.judge import Fitted, in_common, in_own, meant_joint, rms
from stiction_experiments.peers.records import Problem, Record, cut, simulated_excitation
from stiction_experiments.peers.study import PeerRow, lead, means

QUIET = SensorNoise.white(1e-6, 1e-6)
"""Next to no noise."""


def problem(seconds: float = 6.0, seed: int = 0, noise: SensorNoise | None = QUIET) -> Problem:
    """Return the problem of the paper's shank motor: 0.0145 kg m², 0.0704 N m s/rad, 0.442 N m, −0.05 N m."""
    log = example_log(SATURN_LITE, simulated_excitation(seed, seconds), noise, seed)
    return Problem.of(log, IdentifySetup().with_sidecar(log.setup_of("shank")))


@pytest.fixture(scope="module")
def shank() -> Problem:
    """Return the problem without noise."""
    return problem()


def row(joint: str, peer: str, error: float | None) -> PeerRow:
    """Return a row of one record."""
    return PeerRow("record", joint, peer, "coulomb", error, error, None, 1.0, "")


def test_the_error_is_root_mean_square(shank: Problem) -> None:
    """Half of the samples off by 3 and half by 4 are off by √12.5; what is no number has no error."""
    off = np.where(np.arange(len(shank.time)) % 2, 3.0, 4.0)
    assert rms(shank, shank.position + off) == pytest.approx(np.sqrt(12.5))
    assert rms(shank, np.full_like(shank.position, np.nan)) is None


def test_a_fit_without_a_late_controller_means_another_joint(shank: Problem) -> None:
    """Ten milliseconds at kp 20 and kd 0.5: 0.5·0.01 − 20·0.01²/2 = 0.004 kg m², and 20·0.01 = 0.2 N m s/rad."""
    meant = meant_joint({"inertia": 0.01, "viscous_friction": 0.1, "offset": 1.0}, shank, 0.01)
    assert meant == pytest.approx({"inertia": 0.014, "viscous_friction": 0.3, "offset": 1.0})


def test_the_simple_simulation_is_the_exact_one(shank: Problem) -> None:
    """Stick and slip in steps of 1 ms stay within 0.1 mrad of their exact instants."""
    exact = simulate(
        SATURN_LITE.joint, SATURN_LITE.gains, shank.step, shank.target, float(shank.position[0]), shank.speed
    )
    near = plain.simulate(shank, (0.0145, 0.0704, 0.442, -0.05, 0.0, 0.0, 0.0))
    assert np.sqrt(np.mean((near - exact.position) ** 2)) < 1e-4


def test_both_simulations_agree_on_a_late_loop(shank: Problem) -> None:
    """Four milliseconds move the joint by several milliradians, and both simulations by the same."""
    values = {"inertia": 0.0145, "viscous_friction": 0.0704, "coulomb_friction": 0.442, "offset": -0.05}

    def own(other: Problem) -> np.ndarray:
        return plain.simulate(other, (*values.values(), 0.0, 0.0, 0.004))

    late = replace(shank, run=shank.run, position=own(shank))
    fitted = Fitted("coulomb", values, reading=replace(Fitted("").reading, delay=0.004), own=own)
    assert in_own(late, fitted) == 0.0
    common, punctual = in_common(late, fitted), in_common(late, Fitted("coulomb", values))
    assert common is not None and punctual is not None and common < 0.1 * punctual


def test_the_textbook_finds_what_was_simulated(shank: Problem) -> None:
    """Without noise least squares on torque has inertia, friction and offset to 3 %, and predicts another motion."""
    fitted = plain.fit_textbook(shank)
    assert fitted.values == pytest.approx(
        {"inertia": 0.0145, "viscous_friction": 0.0704, "coulomb_friction": 0.442, "offset": -0.05}, rel=0.03
    )
    error = in_common(problem(seed=7), fitted)
    assert error is not None and error < 3e-4


def test_output_error_finds_what_was_simulated(shank: Problem) -> None:
    """SciPy's search ends at the truth to 1 %, with no delay where there is none."""
    fitted = plain.fit_output_error(shank, plain.fit_textbook(shank))
    assert fitted.values is not None and fitted.values["coulomb_friction"] == pytest.approx(0.442, rel=0.01)
    assert fitted.values["inertia"] == pytest.approx(0.0145, rel=0.01) and fitted.reading.delay < 2e-4


def test_the_objective_of_the_paper_does_not_know_the_joint(shank: Problem) -> None:
    """A tenth of a radian between reference and angle is 0.01 rad² for every joint, and there is no prediction."""
    away = replace(shank, position=shank.target - 0.1)
    assert plain.paper_objective(away, 1.0, 2.0, 3.0) == pytest.approx(0.01)
    assert plain.paper_objective(away, 9.0, 0.0, 0.0) == plain.paper_objective(away, 1.0, 2.0, 3.0)
    fitted = plain.fit_paper(shank, Fitted(""))
    assert in_common(shank, fitted) is None and in_own(shank, fitted) is None and "1 value" in fitted.note


def test_sysid_finds_what_was_simulated(shank: Problem) -> None:
    """MuJoCo's toolbox has the friction to 1 %, and follows the log to a tenth of a milliradian in MuJoCo."""
    pytest.importorskip("tabulate", reason="the extra mujoco[sysid] is needed")
    from stiction_experiments.peers.mujoco_sysid import fit_sysid

    fitted = fit_sysid(shank, plain.fit_textbook(shank))
    assert fitted.values is not None and fitted.values["coulomb_friction"] == pytest.approx(0.442, rel=0.01)
    own, common = in_own(shank, fitted), in_common(shank, fitted)
    assert own is not None and own < 1e-4
    # Its joint means the same in the simulation that all share.
    assert common is not None and common < 4e-4


def test_gravity_is_the_same_in_mujoco() -> None:
    """A link held by 2.2 sin θ + 0.4 cos θ comes to rest where the exact simulation has it."""
    pytest.importorskip("tabulate", reason="the extra mujoco[sysid] is needed")
    from stiction.identification.example import LEG
    from stiction_experiments.peers.mujoco_sysid import follow

    log = example_log(LEG, simulated_excitation(0, 6.0), QUIET)
    leg = Problem.of(log, IdentifySetup().with_sidecar(log.setup_of("shank")))
    values = {"inertia": 0.06, "viscous_friction": 0.0704, "coulomb_friction": 0.442, "offset": -0.05}
    error = rms(leg, follow(leg, values | {"gravity_sin": 2.2, "gravity_cos": 0.4}, 0.0))
    assert leg.gravity and error is not None and error < 1e-3


def test_bam_finds_what_was_simulated(shank: Problem) -> None:
    """BAM's Coulomb law has the friction to 3 %, and follows the log to 0.2 mrad in its own simulator."""
    pytest.importorskip("bam", reason="better-actuator-models is needed")
    from stiction_experiments.peers.bam import Search

    textbook = plain.fit_textbook(shank).values
    assert textbook is not None
    search = Search.of("m1", shank, dict(textbook), 0.5 * shank.step)
    cost, point = search.solve(shank)
    best = dict(zip(search.names, point, strict=True))
    assert best["friction_base"] == pytest.approx(0.442, rel=0.03)
    assert np.sqrt(cost) * np.std(shank.position) < 2e-4


def test_a_toolbox_that_is_not_installed_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """One sentence names how to install it."""
    monkeypatch.setattr(util, "find_spec", lambda name: None)
    sentence = study.missing_toolboxes()["bam"]
    assert sentence.startswith("BAM is not installed") and "pip install" in sentence and "\n" not in sentence


def test_the_lead_names_joints_on_which_identification_is_behind() -> None:
    """Ahead on the first joint, behind SciPy on the second; the true joint and its own second row do not count."""
    rows = [row("a", "stiction", 1.0), row("a", "scipy", 2.0), row("b", "stiction", 4.0), row("b", "scipy", 3.0)]
    rows += [row("b", study.TRUTH, 0.1), row("b", study.COULOMB, 0.2), row("b", "paper", None)]
    assert lead(rows) == "record: ahead of all others on 1 of 2; behind on b (scipy: 3 against 4)"
    table = {one.peer: one for one in means(rows)}
    # √(1·4) and √(2·3).
    assert table["stiction"].error == pytest.approx(2.0) and table["scipy"].error == pytest.approx(np.sqrt(6.0))
    assert table["scipy"].ahead == 1 and table["paper"].error is None and table["paper"].ahead == 1


def test_a_record_is_cut_in_two_without_a_common_sample() -> None:
    """Seven tenths of a hundred samples are 70, and the rest begins behind them."""
    log = example_log(SATURN_LITE, simulated_excitation(0, 0.2))
    first, rest = cut(log, 0.0, 0.7), cut(log, 0.7, 1.0)
    assert len(first.time) == 70 and len(rest.time) == 30 and first.time[-1] < rest.time[0]
    assert len(rest.joints["shank"].position) == 30


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """One short record in place of all simulated ones."""

    def one(seeds: tuple[int, ...], seconds: float = 0.0) -> list[Record]:
        logs = [example_log(SATURN_LITE, simulated_excitation(seed, 6.0), seed=seed) for seed in (*seeds, 1000)]
        return [Record("coulomb", "seed 0", False, *logs, IdentifySetup().with_sidecar(logs[0].setup_of("shank")))]

    monkeypatch.setattr(records, "simulated_records", one)


@pytest.mark.usefixtures("short", "undrawn")
def test_the_study_judges_all_by_one_record(tmp_path: Path) -> None:
    """Identification, regression and the true joint predict to the noise; without friction nothing does."""
    command = ["study", "peers", "--records", "simulated", "--peers", "regression", "paper", "--jobs", "1"]
    assert main([*command, "--out", str(tmp_path)]) == 0
    with (tmp_path / "peers.csv").open() as file:
        errors = {line["peer"]: line["error"] for line in csv.DictReader(file)}
    assert errors["paper"] == "" and float(errors["no friction"]) > 20 * float(errors["stiction"])
    for peer in ("stiction", "regression", study.TRUTH):
        assert float(errors[peer]) < 1e-3
    assert json.loads((tmp_path / "summary.json").read_text())["left_out"].keys() <= {"bam", "sysid"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--peers", "scpy"), "did you mean 'scipy'"),
        (("--records", "measured", "measured"), "each once"),
    ],
)
def test_wrong_words_are_refused(arguments: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A name that is no estimator, and the same records twice."""
    try:
        status = main(["study", "peers", *arguments])
    except (StictionError, SystemExit) as error:
        status = 1
        assert message in str(error) + capsys.readouterr().err
    else:
        assert status and message in capsys.readouterr().err
