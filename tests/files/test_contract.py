"""The contract refuses what no runtime could obey, and names the field."""

import json

import numpy as np
import pytest

from bundles import aged, make_contract
from stiction.core.errors import BundleError, StictionError
from stiction.files.contract import Contract, read_contract
from stiction.files.observation import proprioception
from stiction.joints.compensation import compensated
from stiction.joints.friction import Law
from stiction.robots.catalog import find_robot


def edited(contract: Contract, field: str, value: object) -> bytes:
    """Return contract.json with one field replaced."""
    data = json.loads(contract.to_json())
    data[field] = value
    return json.dumps(data).encode()


def test_what_is_written_is_read_back(contract: Contract) -> None:
    """Eighteen joints, and twelve with an identification and an Actuator Net."""
    net = {"name": "net", "sha256": "0" * 64}
    for each in (contract, make_contract("go1", joints_file=net | {"name": "joints.json"}, actuator=net)):
        assert read_contract(each.to_json().encode()) == each


def test_a_contract_from_before_speeds_compensates_by_the_error_alone() -> None:
    """Its policy would walk otherwise than it was trained: at any speed, 0.1 rad from 0.02 rad before the target on."""
    data = json.loads(make_contract(compensation=(0.1,) * 18, compensation_width=0.02).to_json())
    del data["compensation_speeds"], data["target_limits"], data["command_correction"]
    push = read_contract(json.dumps(data).encode()).push
    position, velocity = np.zeros(3), np.array([0.0, 5.0, -5.0])
    np.testing.assert_allclose(compensated(np.full(3, 0.5), position, velocity, 0.1, push), 0.6, atol=1e-12)
    np.testing.assert_allclose(compensated(np.full(3, 0.01), position, velocity, 0.1, push), 0.06, atol=1e-12)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *(("seed", True), ("friction_law", "rust"), ("friction_range", [0.2, 0.1]), ("joint_names", ["a"] * 18)),
        *(("control_period", 0.025), ("kp", [40.0] * 17), ("standing", [9.0] * 18), ("action_clip", 10**400)),
        ("compensation", [-0.1] * 18),
        ("target_limits", {"slew": 40.0, "margin": 1.0}),
        ("imported", {"name": "net", "sha256": "0" * 64, "preset": "mjlab"}),
        ("imported", {"name": "net", "sha256": "0" * 64, "preset": "mjlab", "assumed": 5}),
        ("imported", {"name": "net", "preset": "mjlab", "assumed": "kp"}),
    ],
)
def test_a_wrong_field_is_refused_by_name(contract: Contract, field: str, value: object) -> None:
    """A runtime that takes a wrong number moves a robot wrongly."""
    with pytest.raises(BundleError, match=field):
        read_contract(edited(contract, field, value))


@pytest.mark.parametrize(
    ("version", "message"),
    [
        (3, r"schema version 3; this program reads 1 to 2; update stiction"),
        (0, r"schema version 0; this program reads 1 to 2; export the bundle again"),
        ("2", r"schema version '2'; this program reads 1 to 2; export the bundle again"),
        (True, r"schema version True; this program reads 1 to 2; export the bundle again"),
    ],
)
def test_another_version_is_said_before_any_field(contract: Contract, version: object, message: str) -> None:
    """A field that only this version has was said to be missing, and nobody was told to update."""
    data = json.loads(contract.to_json()) | {"schema_version": version, "from_the_future": 1}
    del data["compensation_speeds"], data["target_limits"], data["command_correction"]
    with pytest.raises(BundleError, match=f"^contract.json: {message}$"):
        read_contract(json.dumps(data).encode())


@pytest.mark.parametrize(
    ("entry", "value"), [("size", 17), ("scale", 0.0), ("clip", "5"), ("offset", "zero"), ("size", 18.0)]
)
def test_a_wrong_observation_term_is_refused_by_name(contract: Contract, entry: str, value: object) -> None:
    """An observation that is scaled or sized otherwise is another input."""
    data = json.loads(contract.to_json())
    term = next(term for term in data["observation"]["terms"] if term["name"] == "joint_position")
    term[entry] = value
    with pytest.raises(BundleError, match=rf"(joint_position\.|terms\[5\]: ){entry}"):
        read_contract(json.dumps(data).encode())


@pytest.mark.parametrize("law", ["load", "effort"])
def test_a_coefficient_is_its_own_level(law: str) -> None:
    """Divided by the torque limit, 0.05 would be 0.2 %; and a law without its own numbers is another law."""
    level = make_contract(friction_law=law, friction_level=0.05, friction=(0.05,) * 18)
    assert read_contract(level.to_json().encode()) == level and level.law == Law(law)
    with pytest.raises(BundleError, match=r"mean of 'friction'$"):
        read_contract(edited(level, "friction", [1.25, 1.25, 2.25] * 6))
    with pytest.raises(BundleError, match="stribeck"):
        read_contract(edited(level, "stribeck", [1.5, 0.1]))


SPANS = {"forward": [-0.8, 0.8], "sideways": [-0.3, 0.3], "turn": [-0.6, 0.6]}


def test_the_trained_commands_go_with_the_policy() -> None:
    """Nobody else knows how fast it may be asked to walk. Bundles of before say nothing."""
    contract = make_contract(anatomy=find_robot("saturn_lite"))
    told = read_contract(edited(contract, "command_range", SPANS))
    assert told.command_range == {name: tuple(ends) for name, ends in SPANS.items()}
    assert read_contract(told.to_json().encode()) == told
    older = read_contract(json.dumps(aged(contract, "command_range")).encode())
    assert older == contract and contract.command_range is None
    for wrong in ({"forward": [0, 1]}, SPANS | {"turn": [1, 0]}):
        with pytest.raises(BundleError, match="command_range"):
            read_contract(edited(contract, "command_range", wrong))


def told(**changes) -> Contract:
    """Return the contract of a policy that is told its joints' friction."""
    values = {
        "observation": proprioception(18, known_kinds=3),
        "known_friction": {"hip": 0.1, "thigh": 0.2, "shank": 0},
    }
    return make_contract(**(values | changes))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("known_friction", {"hip": 0.1, "thigh": 0.1}),
        ("known_friction", {"hip": 0.1, "thigh": 0.1, "elbow": 0.1}),
        ("known_friction", {"hip": 0.1, "thigh": 0.1, "shank": -0.1}),
        ("known_friction_file", {"name": "joints.json"}),
    ],
)
def test_what_is_told_is_of_the_robots_own_kinds_of_joints(field: str, value: object) -> None:
    """A number of another joint, or none at all, would be observed as if it were right."""
    with pytest.raises(BundleError, match=field):
        read_contract(edited(told(), field, value))


def test_slow_means_go_with_their_time(contract: Contract) -> None:
    """The runtime weighs the past as training did; without the number, or with another size, it would not."""
    slow = make_contract(observation=proprioception(18, slow_kept=0.98))
    assert read_contract(slow.to_json().encode()) == slow and slow.observation.frame_size == 65 + 3 * 18
    data = json.loads(slow.to_json())
    data["observation"]["slow_kept"] = None
    with pytest.raises(StictionError, match="slow_error, slow_speed, slow_power with slow_kept None"):
        read_contract(json.dumps(data).encode())
    data = json.loads(contract.to_json())
    del data["observation"]["slow_kept"]
    assert read_contract(json.dumps(data).encode()) == contract
    with pytest.raises(BundleError, match=r"observation\.\w+\.size"):
        make_contract(observation=proprioception(17, slow_kept=0.98))
