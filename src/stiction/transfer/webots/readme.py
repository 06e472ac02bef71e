"""The README of an exported Webots project: how to start it, what it is made of, and that nobody has run it."""

from __future__ import annotations

from collections.abc import Mapping

from stiction import __version__
from stiction.formats.bundle import Bundle
from stiction.formats.friction import level_text
from stiction.robots.spec import JOINT_KINDS, RobotSpec, box_inertia
from stiction.transfer.webots.controller import PLUGIN
from stiction.transfer.webots.proto import FARTHEST, friction_field, proto_name, stops

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

It is a field of the robot for each kind of joint, in N m, in `worlds/*.wbt` and in Webots' scene tree. It was exported
at {exported:g} % of the torque limits.

| | torque limit [N m] | exported | 10 % | 20 % | 30 % |
|---|---|---|---|---|---|
{friction}

Webots' `staticFriction` acts only while a controller sets torques, as this one does; under Webots' own position or
velocity control it does nothing (cyberbotics/webots#2483). A change acts from the next start of the simulation.

## What to look at first

1. The console says `rotor_inertia: {joints} joints have rotor inertia`. Without it the controller refuses to walk: a
   shank would have {knee:.0f} % of its inertia about the knee, and the joint controller may ring.
2. The robot stands in its standing pose, feet on the ground, before the controller starts.
3. `--command stand` stands still; after that `--command vx=0.5`.

## What is different from the simulation that the policy was trained in

* Contacts: Webots' own (`softCFM` 0.001, `softERP` 0.2, friction pyramid), bounce 0, Coulomb coefficient 1.
* kd acts explicitly, from the velocity at the start of each physics step; MuJoCo takes it implicitly.
* The shank collides with everything, in training with obstacles alone; its lower end is within the foot. The robot's
  own parts do not collide with each other.
* Angles in Webots count from the standing pose. {clipped}
* No sensor noise, no delay. Laws of friction other than Coulomb's are not here.
"""


def write_readme(spec: RobotSpec, bundle: Bundle, policy: str, level: float, step_height: float) -> str:
    """Return the text of README.md.

    policy: name of the bundle; level: dry friction in the worlds, a fraction of the torque limits [-]; step_height [m].
    """
    contract = bundle.contract
    return TEMPLATE.format(
        robot=proto_name(spec.name),
        policy=policy,
        digest=bundle.digest,
        method=contract.method,
        law=contract.friction_law,
        level=level_text(contract.friction_law, contract.friction_level),
        timestep=1000 * contract.physics_timestep,
        period=1000 * contract.control_period,
        version=__version__,
        plugin=PLUGIN,
        step_height=step_height,
        exported=100 * level,
        friction=_friction_rows(spec, {"exported": level, "10": 0.1, "20": 0.2, "30": 0.3}),
        joints=spec.num_joints,
        knee=100 * _share_of_link(spec, contract.armature[spec.joint_names.index(f"{spec.legs[0].name}_shank")]),
        clipped=_clipped(spec),
    )


def _friction_rows(spec: RobotSpec, levels: Mapping[str, float]) -> str:
    """Return the rows of the table of friction torques [N m]."""
    rows = []
    for kind in JOINT_KINDS:
        limit = getattr(spec, kind).torque_limit
        torques = " | ".join(f"{level * limit:g}" for level in levels.values())
        rows.append(f"| `{friction_field(kind)}` | {limit:g} | {torques} |")
    return "\n".join(rows)


def _share_of_link(spec: RobotSpec, armature: float) -> float:
    """Return the shank's share of the inertia about the knee, the rotor being the rest [-]; armature [kg m²]."""
    link = spec.shank_link
    inertia = box_inertia(link.mass, link.size)[1] + link.mass * (link.size[2] / 2) ** 2
    return float(inertia / (inertia + armature))


def _clipped(spec: RobotSpec) -> str:
    """Say which stops are nearer than the robot's, since Webots sees angles modulo 2π."""
    nearer = []
    for kind in JOINT_KINDS:
        joint = getattr(spec, kind)
        if stops(joint) != (joint.lower - joint.standing, joint.upper - joint.standing):
            nearer.append(kind)
    if not nearer:
        return "Stops are the robot's."
    return f"Stops of {' and '.join(nearer)} are nearer than the robot's: {FARTHEST:g} rad from standing at most."
