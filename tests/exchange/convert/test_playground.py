"""Pages for MuJoCo Playground, run in MJX where JAX is installed, elsewhere only compiled."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from code_blocks import blocks_of
from motors import motor, number
from stiction.exchange.randomization import recipe_of
from stiction.exchange.targets import TARGETS, ConvertOptions, convert
from stiction.files.joints import JointsFile

PAGE = Path(__file__).parents[3] / "docs/trainers.md"
MODEL = """<mujoco><option timestep="0.004" iterations="1" ls_iterations="5" gravity="0 0 0"/><worldbody>
<body><joint name="hip" axis="0 1 0" frictionloss="0.3" damping="0.5"/><geom size=".1" pos=".2 0 0" mass="1"
contype="0"/></body>
<body><joint name="knee" axis="0 1 0" frictionloss="1"/><geom size=".1" pos=".2 0 0" mass="1" contype="0"/></body>
<body><joint name="bare" axis="0 1 0"/><geom size=".1" pos=".2 0 0" mass="1" contype="0"/></body>
</worldbody></mujoco>"""


def ranges(**limits: float) -> str:
    """Return the text that draws 10 to 24 % of torque limits."""
    friction = {"method": "deception", "level": 0.2, "law": "coulomb", "per": "robot"}
    write = TARGETS["playground"].ranges
    assert write is not None
    return write(recipe_of({"friction": friction, "range": [0.1, 0.24]}, limits), ConvertOptions(to="playground")).text


def values() -> str:
    """Return the text that sets a hip."""
    record = motor(coulomb_friction=number(0.5))
    return convert(JointsFile({"hip": record}), ConvertOptions(to="playground")).text


def domain_randomize(text: str):
    """Return the function that a text defines, its imports of JAX and MJX included."""
    pytest.importorskip("mujoco.mjx", reason="mujoco-mjx and jax are not installed; pip install mujoco-mjx jax")
    defined: dict = {}
    exec(compile(text, "friction.py", "exec"), defined)
    return defined["domain_randomize"]


def test_the_text_compiles_and_is_short() -> None:
    """A function of some 30 lines, as Playground's registry takes it."""
    for text in (values(), ranges(hip=10.0, knee=20.0)):
        compile(text, "friction.py", "exec")
        body = text[text.index("def domain_randomize(model, rng):") :]
        assert len(body.splitlines()) < 40 and "opt.ls_iterations" in body


def test_friction_is_drawn_a_share_a_robot_and_holds() -> None:
    """Worlds differ, joints of a world have one share; under 0.9 of its friction a joint stays, over it goes."""
    draw = domain_randomize(ranges(hip=10.0, knee=20.0))
    import jax
    import mujoco
    from mujoco import mjx

    model = mjx.put_model(mujoco.MjModel.from_xml_string(MODEL))
    worlds, axes = draw(model, rng=jax.random.split(jax.random.PRNGKey(0), 8))
    friction = np.array(worlds.dof_frictionloss)
    share = friction[:, :2] / (10.0, 20.0)
    np.testing.assert_allclose(share[:, 0], share[:, 1], rtol=1e-5)
    assert share.min() >= 0.1 and share.max() <= 0.2401 and len(np.unique(share[:, 0])) == 8
    assert not friction[:, 2].any() and (worlds.opt.iterations, worlds.opt.ls_iterations) == (20, 50)

    def moved(factor: float) -> np.ndarray:
        def walk(world, friction):
            data = mjx.make_data(world).replace(qfrc_applied=factor * friction)
            return jax.lax.fori_loop(0, 50, lambda _, data: mjx.step(world, data), data).qpos

        return np.array(jax.jit(jax.vmap(walk, in_axes=(axes, 0)))(worlds, worlds.dof_frictionloss))

    assert np.abs(moved(0.9)[:, :2]).max() < 1e-3 and moved(1.1)[:, :2].min() > 5e-3


def test_values_are_the_same_in_all_worlds() -> None:
    """Friction and armature of the identified joint, damping on top of the controller's; others keep theirs."""
    draw = domain_randomize(values())
    import jax
    import mujoco
    from mujoco import mjx

    model = mjx.put_model(mujoco.MjModel.from_xml_string(MODEL))
    worlds, axes = draw(model, jax.random.split(jax.random.PRNGKey(0), 3))
    np.testing.assert_allclose(worlds.dof_frictionloss, [[0.5, 1.0, 0.0]] * 3)
    np.testing.assert_allclose(worlds.dof_damping, [0.57, 0.0, 0.0])
    np.testing.assert_allclose(worlds.dof_armature, [0.03, 0.0, 0.0], atol=1e-7)
    assert axes.dof_damping is None and axes.dof_frictionloss == 0


def page_function(word: str, **names: Any) -> Any:
    """Return the function of that name in a block of the page, run with `names`."""
    (block,) = (block for block in blocks_of(PAGE) if f"def {word}(" in block.text)
    exec(block.text, names)
    return names[word]


def test_the_page_draws_friction_over_the_identified_damping(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second function gets what the first one changed, and the friction of one robot that the model had."""

    class Model:
        """Substitute for the used part of `mjx.Model`."""

        def __init__(self, **fields: Any) -> None:
            vars(self).update(fields)

        def tree_replace(self, fields: dict) -> Model:
            return Model(**(vars(self) | fields))

    def same(model: Model, rng: Any) -> tuple:
        return model.tree_replace({"dof_frictionloss": [[0.5]] * 3, "dof_damping": [0.57]}), "axes"

    monkeypatch.setitem(sys.modules, "values", SimpleNamespace(domain_randomize=same))
    monkeypatch.setitem(
        sys.modules, "friction", SimpleNamespace(domain_randomize=lambda model, rng: (vars(model), rng))
    )
    parameters, rng = page_function("randomize")(Model(dof_frictionloss=[0.3], dof_damping=[0.5]), "rng")
    assert parameters == {"dof_frictionloss": [0.3], "dof_damping": [0.57]} and rng == "rng"


def test_identified_damping_and_drawn_friction_act_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """The page's function of both files, in MJX."""
    for name, text in {"values": values(), "friction": ranges(hip=10.0, knee=20.0)}.items():
        monkeypatch.setitem(sys.modules, name, SimpleNamespace(domain_randomize=domain_randomize(text)))
    import jax
    import mujoco
    from mujoco import mjx

    model = mjx.put_model(mujoco.MjModel.from_xml_string(MODEL))
    worlds, axes = page_function("randomize")(model, jax.random.split(jax.random.PRNGKey(0), 4))
    share = np.array(worlds.dof_frictionloss)[:, :2] / (10.0, 20.0)
    np.testing.assert_allclose(share[:, 0], share[:, 1], rtol=1e-5)
    np.testing.assert_allclose(worlds.dof_damping, [0.57, 0.0, 0.0])
    np.testing.assert_allclose(worlds.dof_armature[0], 0.03, atol=1e-7)
    assert share.min() >= 0.1 and len(np.unique(share[:, 0])) == 4 and axes.dof_frictionloss == 0
    jax.vmap(lambda world: mjx.step(world, mjx.make_data(world)).qpos, in_axes=(axes,))(worlds)


def test_both_functions_of_the_page_act_together() -> None:
    """The task scales friction and mass; friction is then ours, mass the task's."""
    draw = domain_randomize(ranges(hip=10.0, knee=20.0))
    import jax
    import mujoco
    from mujoco import mjx

    def task_randomize(model, rng):
        mass = jax.vmap(lambda key: model.body_mass * jax.random.uniform(key))(rng)
        friction = jax.vmap(lambda key: model.dof_frictionloss[:2] * jax.random.uniform(key, (2,)))(rng)
        axes = jax.tree_util.tree_map(lambda _: None, model)
        axes = axes.tree_replace({"body_mass": 0, "dof_frictionloss": 0})
        return model.tree_replace({"body_mass": mass, "dof_frictionloss": friction}), axes

    both = page_function("both", randomize=draw, task_randomize=task_randomize)
    model = mjx.put_model(mujoco.MjModel.from_xml_string(MODEL))
    worlds, axes = both(model, jax.random.split(jax.random.PRNGKey(0), 4))
    share = np.array(worlds.dof_frictionloss)[:, :2] / (10.0, 20.0)
    np.testing.assert_allclose(share[:, 0], share[:, 1], rtol=1e-5)
    assert share.min() >= 0.1 and worlds.opt.ls_iterations == 50 and axes.body_mass == axes.dof_frictionloss == 0
    jax.vmap(lambda world: mjx.step(world, mjx.make_data(world)).qpos, in_axes=(axes,))(worlds)


@pytest.mark.parametrize(("joint", "message"), [("bare", "MJX makes friction rows where"), ("neck", "no joint 'neck'")])
def test_what_would_not_act_is_refused(joint: str, message: str) -> None:
    """Rejects friction for a joint whose model has none, which MJX ignores."""
    draw = domain_randomize(ranges(**{joint: 10.0}))
    import jax
    import mujoco
    from mujoco import mjx

    model = mjx.put_model(mujoco.MjModel.from_xml_string(MODEL))
    with pytest.raises(ValueError, match=message):
        draw(model, jax.random.split(jax.random.PRNGKey(0), 2))
