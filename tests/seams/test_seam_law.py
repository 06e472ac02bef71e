"""A friction law from outside the package, put into the table: it trains, walks in engines, and slides in a joint."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_contract
from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.engines.engine import JointFriction, Motion
from stiction.files.contract import read_contract
from stiction.joints import friction
from stiction.joints.friction import LAWS, FrictionLaw, Law, LawSpec, Piece, register_law
from stiction.robots.catalog import find_robot
from stiction.sim.fleet import Fleet
from stiction.sim.fleet import JointFriction as FleetFriction

pytestmark = pytest.mark.usefixtures("undrawn")

GROWTH = 0.05
"""Share of the friction at rest that a speed of 1 rad/s adds, and four times as much 2 rad/s."""


class SealPieces(FrictionLaw):
    """Friction that grows with the square of the speed, as secants between 0, 1 and 3 rad/s."""

    def __init__(self, level: float) -> None:
        self.level = level

    def pieces(self, direction: int) -> tuple[Piece, ...]:
        """1 + 0.05 q'² is 1, 1.05 and 1.45 at the knots."""
        return Piece(0.0, self.level, 0.05 * self.level), Piece(1.0, 0.85 * self.level, 0.2 * self.level)


def seal_factor(velocity: np.ndarray) -> np.ndarray:
    """A lip seal that drags more the faster it slides."""
    return 1.0 + GROWTH * np.square(velocity)


SEAL = LawSpec(
    name="seal",
    meaning="a torque that grows with the square of the speed",
    label="seal friction at rest",
    factor=seal_factor,
    reads=("velocity",),
    joint=lambda of: SealPieces(of["coulomb_friction"]),
)


@pytest.fixture(autouse=True)
def registered() -> Iterator[None]:
    """Have the law in the table for one test."""
    register_law(SEAL)
    yield
    del LAWS[SEAL.name]


def test_it_is_in_every_place_that_names_laws() -> None:
    """Choices, contract and labels read the one table; a second law of its name is refused."""
    assert friction.level_text("seal", 0.2) == "20 %"
    assert friction.level_axis("seal") == "seal friction at rest, % of each joint's torque limit"
    contract = make_contract(friction_law="seal")
    assert read_contract(contract.to_json().encode()).law == Law("seal")
    with pytest.raises(StictionError, match="exists already"):
        register_law(SEAL)


def test_a_fleet_and_a_single_robot_have_its_bound() -> None:
    """2 N m at rest; at 2 rad/s a fifth more."""
    fleet = Fleet(find_robot("go1"), 1)
    FleetFriction(fleet, Law("seal")).set_level(np.full((1, 12), 2.0))
    fleet.joint_velocity[0, 0] = 2.0
    fleet.substep()
    assert fleet.friction[0, :2].tolist() == pytest.approx([2.4, 2.0])
    still = Motion(**{part.name: np.zeros(2) for part in fields(Motion)})
    single = JointFriction.under(Law("seal"), np.full(2, 2.0), 0.002)
    moving = replace(still, joint_velocity=np.array([2.0, 0.0]))
    assert single.bound(moving, np.zeros(2)).tolist() == pytest.approx([2.4, 2.0])


def test_it_is_evaluated_by_name(bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """`--friction-law seal`, all robots at once and one robot in an engine; help and refusals list it."""
    out = tmp_path / "walks"
    words = "--friction-levels 0.1 --commands vx=0.5 --episodes 1 --seconds 3 --jobs 1 --engines mujoco mujoco-alone"
    assert main(["evaluate", str(bundle), *words.split(), "--friction-law", "seal", "--out", str(out)]) == 0
    with (out / "results.csv").open(newline="") as file:
        rows = [(row["engine"], row["friction_law"]) for row in csv.DictReader(file)]
    assert rows == [("mujoco", "seal"), ("mujoco-alone", "seal")]
    capsys.readouterr()
    with pytest.raises(SystemExit):
        main(["evaluate", str(bundle), "--friction-law", "seals"])
    assert "did you mean 'seal'?" in capsys.readouterr().err


def test_it_trains(tmp_path: Path) -> None:
    """One iteration of four robots; the run says by which law."""
    pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to train")
    words = (
        "--preset quick --robot go1 --num-envs 4 --teacher.iterations 1 --teacher.steps 4 --teacher.mini-batches 2 "
        "--video-every 0 --method direct --friction-level 0.1"
    )
    assert main(["train", *words.split(), "--friction-law", "seal", "--out", str(tmp_path / "run")]) == 0
    assert '"law": "seal"' in (tmp_path / "run" / "config.json").read_text()
