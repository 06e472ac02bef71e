"""Walk imported policies of others in the model that their makers wrote: a control of what `evaluate` says of them.

    python tools/others.py MODEL.xml BUNDLE ...      # some three seconds a bundle

Nothing of our robots and physics is in it: MuJoCo steps the maker's file, its friction and contacts included, at 5 ms;
torques are computed here. The observation and the network are the bundle's. Prints the mean speed forward after 2 s.
"""

from __future__ import annotations

import argparse

import mujoco
import numpy as np

from stiction.core.rotation import into_frame
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import load_policy
from stiction.files.bundle import Bundle, read_bundle

COMMANDS, PERIODS, SETTLE = (0.5, 1.0), 400, 100
"""Forward [m/s]; control periods, and how many of them are not measured."""


def compiled(path: str) -> mujoco.MjModel:
    """Return the maker's model, free and on a floor where its file leaves these to others."""
    spec = mujoco.MjSpec.from_file(path)
    if not any(geom.type == mujoco.mjtGeom.mjGEOM_PLANE for geom in spec.geoms):
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    if not any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.joints):
        spec.worldbody.bodies[0].add_freejoint()
    model = spec.compile()
    model.opt.timestep, model.opt.integrator = 0.005, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    return model


def speed(model: mujoco.MjModel, bundle: Bundle, forward: float) -> float:
    """Return the mean speed along the robot's heading [m/s]."""
    contract, data, speeds = bundle.contract, mujoco.MjData(model), []
    assert contract.anatomy is not None
    joints = [model.joint(name).id for name in contract.joint_names]
    angle, rate = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    kp, kd, limit = (contract.array(name) for name in ("kp", "kd", "torque_limit"))
    data.qpos[angle] = contract.array("standing")
    data.qpos[2:7] = [contract.anatomy.standing_height + 0.02, 1, 0, 0, 0]
    policy, command = load_policy(contract, bundle.policy), np.array([forward, 0.0, 0.0])
    for _ in range(PERIODS):
        sensors = Sensors(data.qpos[3:7].copy(), data.qvel[3:6].copy(), data.qpos[angle], data.qvel[rate])
        target = policy.step(sensors, command).target
        for _ in range(round(contract.control_period / model.opt.timestep)):
            asked = kp * (target - data.qpos[angle]) - kd * data.qvel[rate]
            data.qfrc_applied[rate] = np.clip(asked, -limit, limit)
            mujoco.mj_step(model, data)
        speeds.append(into_frame(data.qpos[3:7], data.qvel[:3])[0])
    return float(np.mean(speeds[SETTLE:]))


def main() -> None:
    """Print a line for each bundle and command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("model", help="the maker's MuJoCo file")
    parser.add_argument("bundles", nargs="+", help="directories of policy bundles")
    asked = parser.parse_args()
    model = compiled(asked.model)
    for name in asked.bundles:
        bundle = read_bundle(name)
        for forward in COMMANDS:
            print(f"{bundle.name} vx={forward:g}: {speed(model, bundle, forward):.2f} m/s", flush=True)


if __name__ == "__main__":
    main()
