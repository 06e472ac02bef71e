"""Walks a policy on Unitree's own simulator, headless, with `stiction deploy`, and adds the figures to a CSV.

    python tools/unitree_simulator.py BUNDLE --simulator ~/unitree_mujoco/simulate_python --python ~/sim/bin/python

The simulator is the maker's (unitree_mujoco, its version in Python), where you have it; `--python` is of an environment
in which its own packages are: mujoco, pygame, unitree_sdk2py. It runs as it is, but for six things: no window, no
gamepad, DDS on loopback without multicast and on the domain of `--domain`, a checksum in its states, which it leaves
at zero, a gyroscope that is never still, as none is, and flat ground in place of its stairs. Friction of the joints is
added to that of its model, as a share of the motors' torque limits.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import runpy
import subprocess
import sys
import tempfile
import types
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

SCRIPT, BRIDGE = "unitree_mujoco.py", "unitree_sdk2py_bridge.py"
"""Files of the simulator, in the folder of `--simulator`."""

SETTLING = 2.0
"""Time after the policy took over that does not count [s]."""

RESTLESS = 0.003
"""Standard deviation of the gyroscope [rad/s]."""

PATIENCE = ("--stale", "0.5", "--gap", "0.5", "--silence", "2")
"""Waits of the supervisor: nothing falls on anybody, and the simulator shares the machine."""

READY = "ready"


class Window:
    """Stands in for the simulator's window: changes the model before the first step, and records where the base is."""

    def __init__(self, friction: float) -> None:
        self._friction, self._open = friction, True
        self.path: list[tuple[float, ...]] = []
        """At each redrawing: time of this machine and of the simulation [s], the base's pose (x, y, z, quaternion)."""

    def launch_passive(self, model: Any, data: Any, **_: Any) -> Window:
        """Take the model that is about to be simulated."""
        import time

        model.dof_frictionloss[6:] += self._friction * model.actuator_ctrlrange[:, 1]
        obstacles = (model.geom_bodyid == 0) & (model.geom_type != 0)
        model.geom_contype[obstacles] = model.geom_conaffinity[obstacles] = 0
        self._sample = lambda: (time.monotonic(), data.time, *data.qpos[:7].tolist())
        return self

    def is_running(self) -> bool:
        """Return whether the simulation is to go on."""
        return self._open

    def sync(self) -> None:
        """Record a sample; the simulation waits meanwhile."""
        self.path.append(self._sample())

    def close(self) -> None:
        """End the simulation."""
        self._open = False


def serve(simulator: Path, domain: int, friction: float, settings: str) -> None:
    """Run the simulator until standard input ends, in the environment of `--python`; print what was seen as JSON."""
    os.chdir(simulator)
    sys.path.insert(0, str(simulator))
    import config  # type: ignore[import-not-found]

    config.DOMAIN_ID, config.INTERFACE, config.USE_JOYSTICK = domain, "lo", 0
    config.PRINT_SCENE_INFORMATION = config.ENABLE_ELASTIC_BAND = False
    import mujoco
    import unitree_sdk2py_bridge as bridge  # type: ignore[import-not-found]
    from unitree_sdk2py.core import channel  # type: ignore[import-not-found]
    from unitree_sdk2py.utils.crc import CRC  # type: ignore[import-not-found]

    channel.ChannelConfigHasInterface = settings
    crc, heard = CRC(), [0, 0]

    class Publisher(bridge.ChannelPublisher):
        def Write(self, sample: Any, *rest: Any) -> Any:
            if isinstance(sample, bridge.LowState_):
                gyroscope = sample.imu_state.gyroscope
                gyroscope[:] = [rate + random.gauss(0.0, RESTLESS) for rate in gyroscope]
                sample.crc = crc.Crc(sample)
            return super().Write(sample, *rest)

    class Bridge(bridge.UnitreeSdk2Bridge):
        def LowCmdHandler(self, msg: Any) -> None:
            heard[0] += 1
            heard[1] += crc.Crc(msg) == msg.crc
            super().LowCmdHandler(msg)

    bridge.ChannelPublisher, bridge.UnitreeSdk2Bridge = Publisher, Bridge
    window = Window(friction)
    mujoco.viewer = sys.modules["mujoco.viewer"] = types.ModuleType("mujoco.viewer")
    mujoco.viewer.launch_passive = window.launch_passive
    runpy.run_path(SCRIPT, run_name="__main__")
    print(READY, flush=True)
    sys.stdin.read()
    window.close()
    print(json.dumps({"commands": heard[0], "right": heard[1], "path": window.path}), flush=True)
    # Its threads are asleep in its library, which has no way to end them.
    os._exit(0)


@dataclass(frozen=True)
class Row:
    """One walk; its fields are the columns of the CSV."""

    policy: str
    """Name of the bundle."""
    friction: float
    """Friction added to each joint, over its motor's torque limit [-]."""
    command: str
    reached: float | None
    """Mean velocity along the command after settling, to the end or a stop, by the simulation's time [m/s]; None of a
    run that ended before."""
    end: str
    commands: int
    """Commands that the simulator took."""
    right: int
    """Commands whose checksum the maker's library finds right."""
    pace: float | None
    """Simulated over real time [-]; well under 1 the figures are of a machine that was too busy."""
    origin: str = field(default="tools/unitree_simulator.py")
    """Program that measured it."""


def main() -> int:
    """Run one walk, add its row, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bundle", type=Path)
    parser.add_argument("--simulator", type=Path, required=True, help="folder simulate_python of unitree_mujoco")
    parser.add_argument("--python", default=sys.executable, help="Python with mujoco, pygame and unitree_sdk2py")
    parser.add_argument("--domain", type=int, default=1, help="DDS domain, 0 to 232")
    parser.add_argument("--friction", type=float, default=0.0, help="share of the torque limits, 0.15")
    parser.add_argument("--command", default="vx=0.5", help="one axis: vx=0.5")
    parser.add_argument("--duration", type=float, default=15.0, help="seconds of the walk")
    parser.add_argument("--out", type=Path, default=Path("results/deploy/unitree_mujoco.csv"))
    parser.add_argument("--serve", help=argparse.SUPPRESS)
    cfg = parser.parse_args()
    simulator = cfg.simulator.expanduser().resolve()
    if missing := [name for name in (SCRIPT, BRIDGE, "config.py") if not (simulator / name).is_file()]:
        parser.error(f"--simulator: got {simulator}, without {missing[0]}; name simulate_python of unitree_mujoco")
    if cfg.serve:
        serve(simulator, cfg.domain, cfg.friction, cfg.serve)
    return walk(cfg, simulator)


def walk(cfg: argparse.Namespace, simulator: Path) -> int:
    """Start the simulator, deploy the policy on it, and add the row; return the exit status of deploy."""
    from stiction.core.errors import StictionError
    from stiction.core.records import read_rows, write_rows
    from stiction.deploy.check import check_bundle
    from stiction.deploy.transports.dds import domain_settings
    from stiction.files.bundle import find_bundle
    from stiction.files.velocity import parse_command

    try:
        check_bundle(find_bundle(cfg.bundle))
        forward, sideways, turn = parse_command(cfg.command).velocity
        read_rows(cfg.out, Row, optional=True)
    except StictionError as error:
        print(f"unitree_simulator.py: {error}", file=sys.stderr)
        return 1
    if turn or bool(forward) == bool(sideways):
        print(f"unitree_simulator.py: --command: got {cfg.command}, expected vx or vy alone, vx=0.5", file=sys.stderr)
        return 1
    words = [cfg.python, __file__, str(cfg.bundle), "--serve", domain_settings("lo"), "--simulator", str(simulator)]
    words += ["--domain", str(cfg.domain), "--friction", str(cfg.friction)]
    process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdin is not None
    try:
        if not any(line == f"{READY}\n" for line in iter(process.stdout.readline, "")):
            print("the simulator did not start; its own lines above say why", file=sys.stderr)
            return 1
        with tempfile.TemporaryDirectory() as folder:
            deploy = [
                sys.executable,
                "-m",
                "stiction",
                "deploy",
                str(cfg.bundle),
                "--robot",
                "unitree-go:lo",
                "--armed",
            ]
            deploy += ["--domain", str(cfg.domain), "--command", cfg.command, "--duration", str(cfg.duration)]
            status = subprocess.run(
                [*deploy, *PATIENCE, "--json", "--out", folder], stdout=subprocess.PIPE, check=False
            ).returncode
            output, _ = process.communicate("")
            if not output.strip():
                print("unitree_simulator.py: the simulator ended before the walk; its lines say why", file=sys.stderr)
                return 1
            row = measured(cfg, json.loads(output.splitlines()[-1]), Path(folder), status)
    finally:
        process.kill()
        process.wait()
    write_rows(cfg.out, [*read_rows(cfg.out, Row, optional=True), row])
    print(row)
    return status


def measured(cfg: argparse.Namespace, seen: dict[str, Any], folder: Path, status: int) -> Row:
    """Return the row of a walk: what the simulator saw while the run's log says that the policy had the robot."""
    import numpy as np

    from stiction.core.errors import StictionError
    from stiction.files.run_log import RUN_STAGE, read_run_log
    from stiction.files.velocity import parse_command

    report = folder / "report.json"
    end = json.loads(report.read_text())["end"] if report.exists() else f"deploy ended with status {status}"
    reached, began = None, [sample for sample in seen["path"] if sample[1] > 0]
    pace = (began[-1][1] - began[0][1]) / (began[-1][0] - began[0][0]) if len(began) > 1 else None
    try:
        readings = read_run_log(folder / "log").readings
        ran = readings["time"][readings["stage"] == RUN_STAGE]
        path = np.array([sample for sample in seen["path"] if ran[0] + SETTLING <= sample[0] <= ran[-1]])
        # Displacement between samples along the heading, and across it.
        w, x, y, z = path[:-1, 5:].T
        heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        dx, dy = np.diff(path[:, 2:4], axis=0).T
        along = np.cos(heading) * dx + np.sin(heading) * dy, np.cos(heading) * dy - np.sin(heading) * dx
        asked = np.array(parse_command(cfg.command).velocity)
        axis = int(np.argmax(np.abs(asked)))
        reached = float(along[axis].sum() / (path[-1, 1] - path[0, 1]))
    except (StictionError, IndexError):
        pass  # The run ended before the policy had walked.
    name = cfg.bundle.name
    return Row(name, cfg.friction, cfg.command, reached, end, seen["commands"], seen["right"], pace)


if __name__ == "__main__":
    sys.exit(main())
