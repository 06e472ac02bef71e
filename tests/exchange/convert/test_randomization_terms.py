"""A proposed range of friction as others draw it: each text is run, MuJoCo's in MuJoCo, others on stand-ins."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
import torch

from motors import motor
from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.exchange.mjlab.lines import training_lines
from stiction.exchange.physics import Which
from stiction.exchange.randomization import FrictionRange, Recipe, recipe_of
from stiction.exchange.targets import RANGES, TARGETS, ConvertOptions, Target, convert
from stiction.files.joints import JointRecord, JointsFile, write_training

TRAINING = {
    "friction": {"method": "deception", "level": 0.2, "law": "coulomb", "per": "robot"},
    "range": [0.0, 0.24],
    "text": "provisional;\nlevel of shank",
}
LIMITS = {"FL_hip": 20.0, "FL.calf": 45.0, "FR_hip": 20.0}


def test_shares_become_newton_metres_joints_of_one_limit_together() -> None:
    """0.24 of 20 and of 45 N m; comments cannot end where the text has a line break."""
    recipe = recipe_of(TRAINING, LIMITS)
    assert recipe.together and recipe.ranges == (
        FrictionRange(("FL_hip", "FR_hip"), 0.0, pytest.approx(4.8)),
        FrictionRange(("FL.calf",), 0.0, pytest.approx(10.8)),
    )
    assert all("\n" not in note for note in recipe.notes)


def term(recipe: Recipe, to: Target, load: float | None = None, which: Which = "moving") -> str:
    """Return the text that draws a range."""
    write = TARGETS[to].ranges
    assert write is not None
    done = write(recipe, ConvertOptions(to=to, assumed_load=load, friction=which))
    assert done.text.startswith(f"# {done.told[0]}\n") and len(done.told) == 1 and len(done.told[0]) < 240
    assert done.told[0].endswith('the page "Which value goes where" of the documentation')
    return done.text


def run(text: str, **modules: ModuleType) -> dict[str, Any]:
    """Run a text with substitutes for its imports; return its names."""
    spaces = {name.replace("__", "."): module for name, module in modules.items()}
    before = {name: sys.modules.get(name) for name in spaces}
    sys.modules.update(spaces)
    try:
        defined: dict[str, Any] = {}
        exec(compile(text, "pasted", "exec"), defined)
        return defined
    finally:
        for name, module in before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module


def module(**values: Any) -> ModuleType:
    """Return a stand-in for a module."""
    made = ModuleType("made")
    vars(made).update(values)
    return made


def test_mujoco_draws_within_the_range_and_holds_the_joint() -> None:
    """One number for all joints; the joint under 90 % of its friction stays where it is."""
    draw = run(term(recipe_of(TRAINING, {"a": 10.0, "b": 20.0}), "mujoco"))["draw_friction"]
    body = '<body><joint name="{0}" axis="0 1 0"/><geom size=".1" mass="1" pos=".2 0 0" contype="0"/></body>'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="0.002" integrator="implicitfast" gravity="0 0 0"/><worldbody>{body.format("a")}'
        f"{body.format('b')}</worldbody></mujoco>"
    )
    rng, drawn = np.random.default_rng(0), []
    for _ in range(200):
        draw(model, rng)
        drawn.append(model.dof_frictionloss.copy())
    shares = np.array(drawn) / (10.0, 20.0)
    assert shares.min() >= 0.0 and 0.22 < shares.max() <= 0.24
    np.testing.assert_allclose(shares[:, 0], shares[:, 1])
    data = mujoco.MjData(model)
    data.qfrc_applied[:] = 0.9 * model.dof_frictionloss
    for _ in range(500):
        mujoco.mj_step(model, data)
    assert np.abs(data.qpos).max() < 1e-3


@pytest.mark.parametrize("which", ["moving", "static"])
def test_mjlab_gets_lines_that_read_the_file(which: Which) -> None:
    """The torque limits are those of the robot there."""
    text = training_lines(Path("out/training.json"), TRAINING, which).text
    asked = ', friction="static"' if which == "static" else ""
    assert text.splitlines()[1:] == [
        "from stiction.mjlab import friction_events",
        "",
        f"cfg.events |= friction_events('out/training.json'{asked})",
    ]


class Asset:
    """An articulation of Isaac Lab, as far as friction is written to it."""

    device = "cpu"

    def find_joints(self, names: list[str], preserve_order: bool) -> tuple[list[int], list[str]]:
        """Return joints by pattern."""
        assert preserve_order
        assert names == ["FL_hip", "FR_hip", r"FL\.calf"]
        return [4, 5, 6], names

    def write_joint_friction_coefficient_to_sim(self, **values: Any) -> None:
        """Store the written values."""
        self.written = values


class ManagerTermBase:
    """Isaac Lab's base of terms that keep something."""

    def __init__(self, cfg: Any, env: Any) -> None:
        self.cfg, self._env = cfg, env


def drawn_in_isaac_lab(text: str) -> dict[str, Any]:
    """Run an event in 300 robots, made and called as by Isaac Lab's event manager; return the written values."""
    stand_ins = {
        "isaaclab": module(),
        "isaaclab__managers": module(EventTermCfg=SimpleNamespace, ManagerTermBase=ManagerTermBase),
        "isaaclab__utils": module(configclass=lambda cls: cls),
    }
    asset = Asset()
    env = SimpleNamespace(scene=type("Scene", (dict,), {"num_envs": 300})({"robot": asset}))
    cfg = run(text, **stand_ins)["FrictionEvents"].joint_friction
    assert issubclass(cfg.func, ManagerTermBase) and cfg.mode == "reset"
    cfg.params = {}
    cfg.func(cfg, env)(env, None, **cfg.params)
    return asset.written


APART = {"friction_ratio": {"value": 0.3}, "dynamic_ratio": {"value": 0.2}, "friction_level": 0.3}


@pytest.mark.parametrize(
    ("per", "load", "joints", "moving"),
    [
        *(("robot", None, {}, 1.0), ("joint", None, {}, 1.0), ("robot", 50.0, {"a": None}, 1.0)),
        ("robot", None, {"a": APART | {"friction_level": 0.1, "dynamic_ratio": None}, "b": APART}, 2 / 3),
    ],
)
def test_isaac_lab_gets_friction_at_rest_and_in_motion_and_no_viscous(
    per: str, load: float | None, joints: dict[str, Any], moving: float
) -> None:
    """The term draws dry friction alone; its ratio at rest to in motion is that of the joint with the level."""
    training = TRAINING | {"friction": TRAINING["friction"] | {"per": per}, "joints": joints}
    recipe = recipe_of(training, LIMITS)
    written = drawn_in_isaac_lab(term(recipe, "isaaclab", load))
    friction = written["joint_friction_coeff"]
    torch.testing.assert_close(written["joint_dynamic_friction_coeff"], moving * friction)
    assert set(written) == {"joint_friction_coeff", "joint_dynamic_friction_coeff", "joint_ids", "env_ids"}
    share = friction / torch.tensor([20.0, 20.0, 45.0]) * (load or 1.0)
    assert friction.shape == (300, 3) and share.min() >= 0.0 and 0.22 < share.max() <= 0.2401
    assert bool((share.std(dim=1) < 1e-6).all()) == (per == "robot")
    newton = drawn_in_isaac_lab(term(recipe, "isaaclab_newton"))
    assert set(newton) == {"joint_friction_coeff", "joint_ids", "env_ids"}
    assert newton["joint_friction_coeff"].max() <= moving * 0.2401 * 45.0


RISES = {"friction_ratio": {"value": 0.18}, "dynamic_ratio": {"value": 0.12}, "friction_level": 0.2}
BOTH = TRAINING | {
    "friction": {"method": "deception", "level": 0.133, "law": "stribeck", "per": "robot"}
    | {"static_ratio": [1.25, 2.0], "stribeck_velocity": [0.04, 0.12]},
    "joints": {"shank": RISES},
}


@pytest.mark.parametrize(("which", "most"), [("moving", 0.16 * 45.0), ("static", 0.24 * 45.0)])
def test_a_place_with_one_number_gets_friction_in_motion(which: Which, most: float) -> None:
    """24 % at rest over 1.5 are 16 % in motion; how much more holds the joint is said, and can be asked for."""
    recipe = recipe_of(BOTH, {"FL.calf": 45.0}, which)
    targets: tuple[Target, ...] = ("mujoco", "legged_gym", "playground", "genesis")
    for to in targets:
        text = term(recipe, to)
        assert f"{most:g})" in text and "24 % of each joint's torque limit at rest;" in text, to
        assert any(note.startswith("breakaway over moving: 1.5; a place with one number") for note in recipe.notes)
    assert f"{most / 50:g})" in term(recipe, "legged_gym", 50.0)
    assert f"{most / 50:g})" in term(recipe, "isaaclab", 50.0)


def test_isaac_lab_draws_the_ratio_too() -> None:
    """1 over 1.25 to 2: one share a robot, of its friction at rest; on Newton that in motion alone is written."""
    written = drawn_in_isaac_lab(term(recipe_of(BOTH, LIMITS), "isaaclab"))
    rest, motion = (written[f"joint_{name}friction_coeff"] for name in ("", "dynamic_"))
    share = motion / rest
    assert 0.5 <= share.min() < 0.51 and 0.79 < share.max() <= 0.8001 and share.std(dim=1).max() < 1e-6
    assert abs(torch.corrcoef(torch.stack([rest[:, 0], share[:, 0]]))[0, 1]) < 0.2, "the two numbers are drawn apart"
    limits = torch.tensor([20.0, 20.0, 45.0])
    newton = drawn_in_isaac_lab(term(recipe_of(BOTH, LIMITS), "isaaclab_newton"))["joint_friction_coeff"] / limits
    assert 0.15 < newton.max() <= 0.8001 * 0.24
    static = drawn_in_isaac_lab(term(recipe_of(BOTH, LIMITS, "static"), "isaaclab_newton", which="static"))
    assert (static["joint_friction_coeff"] / limits).max() > 0.22


@pytest.mark.parametrize("ratio", [None, [2.0, 1.0], [0.5, 1.0], [1.0], 1.5])
def test_a_ratio_that_is_none_is_refused(ratio: Any) -> None:
    """A file that somebody changed."""
    broken = BOTH | {"friction": BOTH["friction"] | {"static_ratio": ratio}}
    with pytest.raises(StictionError, match=r"'friction.static_ratio' is .*; expected the lowest and the highest"):
        recipe_of(broken, LIMITS)


def test_legged_gym_brakes_by_the_drawn_friction_and_draws_at_reset() -> None:
    """At ten times EPSILON all of it, at rest none; joints that are not named have none."""

    class Robot:
        """Substitute for legged_gym's LeggedRobot."""

        num_envs, num_dof, device = 200, 4, "cpu"
        dof_names = ("FL_hip", "FR_hip", "FL.calf", "neck")
        dof_vel = torch.tensor([1.0, -1.0, 0.0, 1.0]).expand(200, 4)

        def _init_buffers(self) -> None: ...

        def reset_idx(self, env_ids: torch.Tensor) -> None: ...

        def _compute_torques(self, actions: torch.Tensor) -> torch.Tensor:
            return actions

    own = run(term(recipe_of(TRAINING, LIMITS), "legged_gym"))
    robot = type("Own", (own["JointFriction"], Robot), {})()
    robot._init_buffers()
    torque = robot._compute_torques(torch.zeros(200, 4))
    torch.testing.assert_close(torque[:, 0], -robot.friction[:, 0])
    torch.testing.assert_close(torque[:, 1], robot.friction[:, 1])
    assert not torque[:, 2:].any() and 4.0 < robot.friction[:, 0].max() <= 4.8
    before = robot.friction.clone()
    robot.reset_idx(torch.tensor([3]))
    changed = (robot.friction != before).any(dim=1)
    assert changed.nonzero().tolist() == [[3]]


def test_legged_gym_gets_values_too() -> None:
    """Dry and viscous friction off the torque, 0.4 + 2 * 0.07 N m at 2 rad/s, and the rotor's inertia."""

    class Robot:
        """Substitute for legged_gym's LeggedRobot."""

        num_envs, num_dof, device = 3, 2, "cpu"
        dof_names = ("neck", "hip")
        dof_vel = torch.full((3, 2), 2.0)

        def _init_buffers(self) -> None: ...

        def _process_dof_props(self, props: Any, env_id: int) -> Any:
            return props

        def _compute_torques(self, actions: torch.Tensor) -> torch.Tensor:
            return actions

    text = convert(JointsFile({"hip": motor()}), ConvertOptions(to="legged_gym")).text
    robot = type("Own", (run(text)["JointFriction"], Robot), {})()
    robot._init_buffers()
    torch.testing.assert_close(robot._compute_torques(torch.zeros(3, 2)), torch.tensor([[0.0, -0.54]]).expand(3, 2))
    props = robot._process_dof_props({"armature": np.zeros(2)}, 0)
    assert props["armature"].tolist() == [0.0, 0.03]


class GenesisRobot:
    """An entity of Genesis, as far as its joints are written to."""

    def __init__(self) -> None:
        self.written: dict[str, tuple] = {}

    def get_joint(self, name: str) -> Any:
        """Return a joint by name."""
        solver = lambda params: self.written.update({name: tuple(params)})  # noqa: E731
        return SimpleNamespace(dofs_idx_local=[{"FL_hip": 6, "FR_hip": 9, "FL.calf": 8}[name]], set_sol_params=solver)

    def __getattr__(self, name: str) -> Any:
        return lambda *values: self.written.update({name: values})


def test_genesis_gets_values_and_ranges() -> None:
    """Numbers by the place of the joint's degree of freedom, rows of friction as stiff as the step allows."""
    robot = GenesisRobot()
    values = run(convert(JointsFile({"FL_hip": motor()}), ConvertOptions(to="genesis")).text)
    values["with_joints"](robot, 0.002)
    assert robot.written["FL_hip"] == (0.004, 1.0, 0.999, 0.999, 0.001, 0.5, 2)
    assert robot.written["set_dofs_frictionloss"] == ([0.4], [6])
    assert robot.written["set_dofs_damping"] == ([0.07], [6]) and robot.written["set_dofs_armature"] == ([0.03], [6])
    run(term(recipe_of(TRAINING, LIMITS), "genesis"))["draw_friction"](robot, torch.arange(50))
    friction, dofs, envs = robot.written["set_dofs_frictionloss"]
    share = friction / torch.tensor([20.0, 20.0, 45.0])
    assert dofs == [6, 9, 8] and len(envs) == 50 and share.max() <= 0.2401 and share.std(dim=1).max() < 1e-6


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an identification and a proposal."""
    JointsFile({"shank": JointRecord(torque_limit=45.0)}).write(tmp_path / "joints.json")
    write_training(tmp_path / "training.json", TRAINING)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("framework", RANGES)
def test_a_user_writes_a_range(folder: Path, capsys: pytest.CaptureFixture, framework: str) -> None:
    """By the limits of the joints that were identified, or of a robot; as text, file and JSON."""
    assert main(["convert", "training.json", "--to", framework]) == 0
    text = capsys.readouterr().out
    compile(text, framework, "exec")
    assert "10.8" in text and "shank" in text
    assert main(["convert", "training.json", "--to", framework, "--robot", "go2", "--out", "events.py"]) == 0
    assert "FL_calf_joint" in (folder / "events.py").read_text() and "note: " in capsys.readouterr().err
    assert main(["convert", "training.json", "--to", framework, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["joints"] == {"shank": "shank"}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["training.json", "--to", "urdf"], "takes the values of a joints.json"),
        (
            ["training.json", "--to", "mjlab", "--robot", "go2"],
            "--robot requires --to mujoco, isaaclab, ",
        ),
        (["training.json", "--to", "mjlab", "--timestep", "0.002"], "--timestep requires --to mujoco;"),
        (["training.json", "--to", "mjlab", "--assumed-load", "5"], "--assumed-load requires --to isaaclab or"),
        (["training.json", "--to", "mujoco", "--joint-map", "a=b"], "--joint-map requires a joints.json;"),
        (["training.json", "--to", "mujoco", "--robot", "go3"], "go3"),
        (["joints.json", "--to", "legged_gym"], "record 'shank' holds nothing that a simulator takes"),
        (["joints.json", "--to", "mjlab"], "record 'shank' holds nothing that a simulator takes"),
        (["joints.json", "--to", "urdf", "--robot", "go2"], "no joint of the model takes the record 'shank'"),
        (["training.json", "--to", "isaaclab", "--friction", "static"], "--friction requires a --to with one number"),
        (["none.json", "--to", "urdf"], "none.json"),
    ],
)
def test_what_a_user_can_mend_is_one_line(
    folder: Path, capsys: pytest.CaptureFixture, words: list[str], message: str
) -> None:
    """Status 1, nothing on standard output."""
    assert main(["convert", *words]) == 1
    told = capsys.readouterr()
    assert told.out == "" and message in told.err and told.err.count("\n") == 1
