"""Export of a policy bundle to a Webots project: protos/, worlds/, controllers/, plugins/. Not run in Webots.

The project is made of the robot's `Robot` (shapes, masses, limits) and of the bundle's contract (gains, rotor
inertia and viscous friction of the joints, rates). The bundle is checked before it is copied, and the copy after.

Webots has no rotor inertia. Lumped into the link it would be wrong: a rotor turns against its link, not with it. In
ODE, which Webots is built on, an angular motor for each joint holds it: a constraint on the joint's rate q' with

    target speed = q' before the step,    CFM = Δt / I,    as good as no bound on its torque

gives the torque -I (q'_after - q'_before) / Δt, which is -I q'': the rotor's, taken implicitly. A test compiles the
plugin and steps it in ODE 0.16, where the ODE library is at hand. **Not run in Webots.** Without rotor inertia a light
link is stiff against its gains at the physics step, and the joint controller may ring.

The plugin reports to the controller in every step (a message on channel `CHANNEL`), and is silent where a
joint of its table is missing: the controller then refuses to walk without rotor inertia.

Source: ODE's manual, "Stops and motor parameters" and "CFM"; docs/reference of https://github.com/cyberbotics/webots,
callback-functions.md and utility-functions.md.
"""

from __future__ import annotations

import math
import shutil
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from stiction import __version__
from stiction.core.errors import BundleError, ConfigurationError, FileError, PolicyError, RobotError, if_per_cent
from stiction.core.files import publish
from stiction.deploy.check import check_bundle
from stiction.exchange.policies.exporter import Exported
from stiction.exchange.webots.controller import CHANNEL, PLUGIN
from stiction.exchange.webots.proto import FARTHEST, friction_fields, number, proto_name, solid_name, stops, write_proto
from stiction.exchange.webots.world import ROBOT, joint_friction, milliseconds, write_world
from stiction.files.bundle import Bundle, read_bundle
from stiction.files.contract import Contract, robot_of
from stiction.joints.friction import MAX_LEVEL, level_text
from stiction.robots.model import Robot
from stiction.robots.terrain import STEEPEST

TABLE = "joints.h"
"""Name of the generated file."""

FIXED = (f"{PLUGIN}.c", "Makefile")
"""Files that are the same for every robot; they lie next to this module."""


def write_table(spec: Robot, contract: Contract) -> str:
    """Return the text of `joints.h`: Δt [s] and, for every joint, the links before and behind it and I [kg m²]."""
    rows = []
    for joint, link in enumerate(spec.links):
        parent = ROBOT if link.parent < 0 else f"{ROBOT}.{solid_name(spec, link.parent)}"
        rows.append(f'  {{"{parent}", "{ROBOT}.{solid_name(spec, joint)}", {number(contract.armature[joint])}}},\n')
    return (
        f"/* {proto_name(spec.name)}: the joints and the inertia of their rotors, at the joint [kg m^2].\n"
        "   Written by `stiction export --to webots`. NOT RUN in Webots. */\n"
        f"#define TIMESTEP {number(contract.physics_timestep)} /* physics step of the world [s] */\n"
        f"#define CHANNEL {CHANNEL} /* of the robot's receiver */\n"
        f"#define JOINTS {len(rows)}\n"
        "static const struct {\n  const char *parent, *child;\n  double inertia;\n} TABLE[JOINTS] = {\n"
        f"{''.join(rows)}}};\n"
    )


def plugin_files(spec: Robot, contract: Contract) -> dict[str, str]:
    """Return name -> text of the files of the plugin's folder."""
    folder = resources.files(__package__)
    return {name: folder.joinpath(name).read_text("utf-8") for name in FIXED} | {TABLE: write_table(spec, contract)}


TEMPLATE = """\
# {robot} in Webots

**Not run.** Neither this project nor any other that `stiction export --to webots` wrote has been opened in Webots:
it could not be installed where this was written. What was tested, short of running: the worlds and the PROTO parse,
names, masses, limits and inertias equal those of the robot; the plugin compiles; the controller gives the policy's own
targets when a stand-in of Webots plays its recorded sensors; and in ODE 0.16, set up from such files as Webots' source
does it, with the plugin and the controller, a shipped policy (deception, 20 %) walks at 20 % friction. If something
does not work, it is ours: please report it.

| | |
|---|---|
| policy | `{policy}`, digest `{digest}` |
| trained with | {method}, {law} friction, nominal {level} |
| physics step, control period | {timestep:g} ms, {period:g} ms |
| Webots | R2023b or later |

## Start

```console
export WEBOTS_HOME=/usr/local/webots     # wherever Webots is
make -C plugins/physics/{plugin}    # compiles the rotor inertia
$WEBOTS_HOME/webots worlds/flat.wbt &    # it waits for the controller
$WEBOTS_HOME/webots-controller controllers/stiction_policy/stiction_policy.py --command vx=0.5
```

The controller runs in the Python that `python3` is, with stiction {version} in it, the base install: neither torch nor
a simulator.

Without a window: `webots --batch --mode=fast --no-rendering --stdout --stderr --minimize worlds/flat.wbt`. On stairs
(`worlds/stairs.wbt`, steps of {step_height:g} m): `--command vx=0.4 --hold-heading --seconds 60`; a policy that was
trained on flat ground may get stuck at their foot. The controller checks the bundle beside it before it does anything,
and prints at the end which share of the commanded speed was reached.

## Joint friction

It is a field of the robot for each kind of joint, in N m, in `worlds/*.wbt` and in Webots' scene tree (for each joint,
where the torque limits of a kind differ). It was exported at {exported:g} % of the torque limits.

| | torque limit [N m] | exported | 10 % | 20 % | 30 % | stops, from standing [rad] |
|---|---|---|---|---|---|---|
{friction}

Webots' `staticFriction` acts only while a controller sets torques, as this one does; under Webots' own position or
velocity control it does nothing (cyberbotics/webots#2483). A change acts from the next start of the simulation.

## What to look at first

1. The console says `rotor_inertia: {joints} joints have rotor inertia`. Without it the controller refuses to walk:
   a light link without its rotor's inertia is stiff against its gains, and the joint controller may ring.
2. The robot stands in its standing pose, feet on the ground, before the controller starts.
3. `--command stand` stands still; after that `--command vx=0.5`.

## What is different from the simulation that the policy was trained in

* Contacts: Webots' own (`softCFM` 0.001, `softERP` 0.2, friction pyramid), bounce 0, Coulomb coefficient 1.
* kd acts explicitly, from the velocity at the start of each physics step; MuJoCo takes it implicitly.
* Parts that touch obstacles alone in training, such as shanks, touch everything here. The robot's own parts do not
  collide with each other.
* Angles in Webots count from the standing pose, and stops are at most {farthest:g} rad from it: see the table.
* No sensor noise, no delay. Laws of friction other than Coulomb's are not here.
"""


def write_readme(spec: Robot, bundle: Bundle, cfg: WebotsCfg) -> str:
    """Return the text of README.md."""
    contract = bundle.contract
    rows = []
    for name, numbers in friction_fields(spec).items():
        joints = [spec.joints[number] for number in numbers]
        torques = (f"{level * joints[0].torque_limit:g}" for level in (1.0, cfg.friction_level, 0.1, 0.2, 0.3))
        reach = dict.fromkeys("{:g} to {:g}".format(*stops(joint)) for joint in joints)
        rows.append(f"| `{name}` | {' | '.join(torques)} | {'; '.join(reach)} |")
    return TEMPLATE.format(
        robot=proto_name(spec.name),
        policy=bundle.name,
        digest=bundle.digest,
        method=contract.method,
        law=contract.friction_law,
        level=level_text(contract.friction_law, contract.friction_level),
        timestep=1000 * contract.physics_timestep,
        period=1000 * contract.control_period,
        version=__version__,
        plugin=PLUGIN,
        step_height=cfg.step_height,
        exported=100 * cfg.friction_level,
        friction="\n".join(rows),
        joints=spec.num_joints,
        farthest=FARTHEST,
    )


CONTROLLER = "stiction_policy"
"""Name of the controller's folder and program."""

NOT_RUN = "written and tested short of running; not run in Webots"
"""Note for every user."""


@dataclass(frozen=True)
class WebotsCfg:
    """Settings of the worlds."""

    friction_level: float = 0.0
    """Dry friction of the joints as a fraction of each one's torque limit [-]; none by default, for the friction of a
    world is to be chosen and not assumed. Webots has Coulomb's law alone."""
    step_height: float = 0.10
    """Height of the stairs' steps [m]. A policy trained on stairs climbed 12 cm in 92 of 100 trials in MuJoCo, without
    friction (`results/stairs`); this is a little less."""

    def __post_init__(self) -> None:
        """Reject impossible worlds."""
        if not 0 <= self.friction_level <= MAX_LEVEL:
            raise ConfigurationError(
                f"friction level {self.friction_level} is outside [0, {MAX_LEVEL}], fractions of the torque limit"
                f"{if_per_cent(self.friction_level)}"
            )
        if not 0 < self.step_height <= STEEPEST["stairs"]:
            raise ConfigurationError(f"step height {self.step_height} m: expected one in (0, {STEEPEST['stairs']}] m")


def export_webots(source: Path, out: Path, cfg: WebotsCfg | None = None, robot: str | None = None) -> Exported:
    """Write the Webots project of a bundle to a folder that does not exist yet, whole or not at all.

    source: directory of the bundle; robot: a robot of the user, `package.module:NAME`, by default the bundle's.

    Raises:
        StictionError: the bundle does not pass its checks, does not fit the robot or Webots, or the folder exists.

    """
    cfg = cfg or WebotsCfg()
    if out.exists():
        raise FileError(f"{out} exists already; choose another --out or remove it")
    bundle = check_bundle(source).bundle
    spec = robot_of(bundle.contract, robot)
    check_fit(spec, bundle.contract)
    with publish(out) as partial:
        partial.mkdir()
        _write(partial, spec, bundle, source, cfg)
    files = sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())
    facts = {"friction_level": cfg.friction_level, "step_height": cfg.step_height, "state": NOT_RUN}
    notes = (f"{NOT_RUN}; {out / 'README.md'} says how to start it",)
    return Exported(out, bundle, spec.name, tuple(files), notes, facts)


def check_fit(spec: Robot, contract: Contract) -> None:
    """Raise `StictionError` where robot and contract differ in what the PROTO takes from one and the controller from
    the other, or where Webots cannot take the contract's physics step: a controller steps in whole milliseconds.
    """
    for name, field in (("standing", "default_position"), ("lower", "lower"), ("upper", "upper")):
        if not np.array_equal(spec.joint_values(field), contract.array(name)):
            raise RobotError(
                f"robot {spec.name!r} has another {name} angle of its joints than the bundle; name the right one with "
                "--robot"
            )
    step = milliseconds(contract.physics_timestep)
    if step < 1 or not math.isclose(step, round(step), abs_tol=1e-6):
        raise PolicyError(
            f"the policy's physics step is {step:g} ms; a controller in Webots steps in whole milliseconds, so this "
            "bundle cannot be exported there"
        )


def _write(folder: Path, spec: Robot, bundle: Bundle, source: Path, cfg: WebotsCfg) -> None:
    """Write the project's files into an empty folder."""
    contract = bundle.contract
    friction = joint_friction(spec, cfg.friction_level)
    program = resources.files(__package__).joinpath("controller.py").read_text("utf-8")
    texts = {
        "README.md": write_readme(spec, bundle, cfg),
        f"protos/{proto_name(spec.name)}.proto": write_proto(spec, contract),
        "worlds/flat.wbt": write_world(spec, contract.physics_timestep, friction),
        "worlds/stairs.wbt": write_world(spec, contract.physics_timestep, friction, cfg.step_height),
        f"controllers/{CONTROLLER}/{CONTROLLER}.py": program,
        **{f"plugins/physics/{PLUGIN}/{name}": text for name, text in plugin_files(spec, contract).items()},
    }
    for name, text in texts.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    copy = folder / "controllers" / CONTROLLER / "bundle"
    shutil.copytree(source, copy)
    # The bundle was read twice, to be checked and to be copied.
    if read_bundle(copy).digest != bundle.digest:
        raise BundleError(f"{source} changed while it was copied; try again")
