"""`stiction view POLICY...`: interactive browser viewer with a friction slider."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from stiction.core.effects import excludes, needs
from stiction.core.errors import ConfigurationError, if_per_cent
from stiction.core.flags import ARGUMENT
from stiction.core.options import read_options
from stiction.files.settings import check_file
from stiction.task.friction import law_flag

if TYPE_CHECKING:
    from stiction.evaluation.newest import NewestPolicy
    from stiction.robots.model import Robot
    from stiction.view.simulation import Simulation, ViewedPolicy

DESCRIPTION = """Watch policies walk side by side in the browser, and change their joints' dry friction while they walk.

Every bundle or training run walks on its own robot, from one start line, under one command. Buttons, sliders, keys and
a gamepad set command, friction, wear, pushes, ground, engine and speed of time; a run's checkpoint can be chosen. Plots
show speed, torque of one joint, true and estimated friction, and the reward terms of a run.

Examples:
  stiction view
  stiction view saturn_lite-flat-none-0.2 saturn_lite-flat-deception-0.2 --command vx=0.5 --friction-level 0.2
  stiction view runs/first --follow
  stiction view BUNDLE --static page.html --seconds 10 --command vx=0.5

The first line shows three shipped policies: trained without friction, at one level, and over a range. The address is
printed; Ctrl-C ends it. Only this machine can connect, unless --host names another address. Time stands still while no
browser is connected. From another machine: ssh -L 8080:127.0.0.1:8080 THIS-MACHINE."""

SHIPPED = ("saturn_lite-flat-none-0.2", "saturn_lite-flat-direct-0.2", "saturn_lite-flat-deception-0.2")
"""Policies to show if none is named."""

POLITE = 10
"""Nice value beside a training, which comes first."""


@dataclass(frozen=True)
class ViewCfg:
    """Options of the verb."""

    policies: Annotated[tuple[Path, ...], ARGUMENT] = ()
    """Directories of bundles, names of bundles that come with the package, or training runs (extra train)."""
    command: str | None = None
    """Initial velocity, vx forward, vy sideways [m/s], wz turn [rad/s]: vx=0.3,wz=0.2, or stand; by default vx=0.5, or
    the fastest that all policies were trained for."""
    friction_level: float = 0.0
    """Initial dry friction, as a fraction of each joint's torque limit [-]; of the laws load and effort, the
    coefficient."""
    friction_law: Annotated[str, law_flag("Law of the dry friction, whatever the training's.")] = "coulomb"
    engine: str = "mujoco"
    """Initial physics engine: mujoco, physx, ode, ode-webots, or package.module:ENGINE of your own."""
    terrain: str = "flat"
    """Initial ground: flat, stairs=0.1 (step height [m]), slope=0.2 (angle [rad]), rough=0.05 (highest slab [m]). A
    course is crossed straight on, unless a turn is commanded."""
    robot: str | None = None
    """Robot of your own, `package.module:NAME` or its file; by default the one that the bundle names."""
    seed: int = 0
    """Seed of sensor noise, and of the slabs of rough ground."""
    port: int | None = None
    """Port to listen on; by default the first free one from 8080 on."""
    host: str = "127.0.0.1"
    """Name or address to listen on; by default this machine's own, which no other machine reaches. Browsers have to use
    the same one, or localhost. No passwords."""
    dark: bool = False
    """Draw dark."""
    follow: bool = False
    """Show each new checkpoint of a training run, and wait for the first."""
    out: Path = Path("stiction-view")
    """Folder for recordings, canonical logs in NPZ; made when first needed."""
    static: Path | None = field(default=None, metadata=excludes("--port", "--host", "--follow", "--out"))
    """Write an HTML file that needs no server, of --seconds at --command and --friction-level, with plots, and end."""
    overwrite: bool = field(default=False, metadata=needs("--static"))
    """Replace an existing file."""
    seconds: float = field(default=10.0, metadata=needs("--static"))
    """Length of the walk of --static [s]."""


def main(arguments: list[str]) -> int:
    """Run the verb; return the exit status."""
    cfg = read_options(ViewCfg, arguments, "stiction view", DESCRIPTION)
    if not 0 < cfg.seconds <= 120:
        raise ConfigurationError(f"--seconds: got {cfg.seconds:g}, expected more than 0 and at most 120; change it")
    if cfg.static is not None:
        check_file(cfg.static, cfg, "--static")  # before the robots are made ready
    else:
        from stiction.view.server import check_port, resolve

        # Before the robots are made ready.
        check_port(cfg.port)
        resolve(cfg.host)
    policies, robot, runs = policies_of(cfg)
    simulation = simulation_of(cfg, policies, robot)
    if cfg.static is not None:
        return write_static(cfg, cfg.static, simulation)
    if cfg.follow:
        os.nice(POLITE)
    try:
        return show(cfg, simulation, runs)
    except KeyboardInterrupt:
        # The usual way to end a viewer.
        return 0


def policies_of(cfg: ViewCfg) -> tuple[list[ViewedPolicy], Robot, dict[int, NewestPolicy]]:
    """Return the policies to view, their robot, and the training runs among them by number."""
    from stiction.deploy.check import check_for_simulation, record_notes
    from stiction.files.bundle import find_bundle
    from stiction.files.contract import robot_of
    from stiction.report.terminal import print_warnings
    from stiction.view.simulation import ViewedPolicy, viewed

    policies: list[ViewedPolicy] = []
    folders: list[str] = []
    robots: list[Robot] = []
    runs: dict[int, NewestPolicy] = {}
    for number, path in enumerate(cfg.policies or map(Path, SHIPPED)):
        if (path / "config.json").is_file():
            from stiction.evaluation.newest import NewestPolicy

            run = runs[number] = NewestPolicy(path, wait=cfg.follow, robot=cfg.robot)
            policies.append(viewed(run))
            robots.append(run.robot)
            folders.append(path.resolve().name)
        else:
            bundle = check_for_simulation(find_bundle(path))
            print_warnings("view", record_notes([bundle]))
            policies.append(ViewedPolicy.of_bundle(bundle))
            robots.append(robot_of(bundle.contract, cfg.robot))
            folders.append(bundle.name)
    if cfg.follow and not runs:
        raise ConfigurationError("--follow: got no training run, expected one; name a run, or leave --follow out")
    shorts = [policy.short for policy in policies]
    for number, policy in enumerate(policies):
        # Two policies of one method, or two runs of one name, are told apart by their folders, else by a number.
        if shorts.count(policy.short) > 1:
            folder = folders[number]
            unique = folder if folders.count(folder) == 1 else f"{folder} {number + 1}"
            policies[number] = replace(policy, name=f"{unique}: {policy.name}")
    return policies, robots[0], runs


def simulation_of(cfg: ViewCfg, policies: list[ViewedPolicy], robot: Robot) -> Simulation:
    """Return the simulation in its initial state."""
    from stiction.core.records import part_of
    from stiction.evaluation.course import parse_course, untrained
    from stiction.files.velocity import parse_command
    from stiction.joints.friction import MAX_LEVEL, Law
    from stiction.view.simulation import Simulation, WorldCfg

    if not 0 <= cfg.friction_level <= MAX_LEVEL:
        meant = if_per_cent(cfg.friction_level)
        raise ConfigurationError(
            f"--friction-level: got {cfg.friction_level:g}, expected 0 to {MAX_LEVEL:g}{meant or '; change it'}"
        )
    command = None if cfg.command is None else parse_command(cfg.command)
    for policy in policies:
        if command is not None and (reason := untrained([command], policy.contract)):
            raise ConfigurationError(f"{policy.name!r}: {reason}; command less")
    world = part_of(WorldCfg, cfg, course=parse_course(cfg.terrain), law=Law(cfg.friction_law))
    simulation = Simulation(policies, robot, world)
    for kind in simulation.kinds:
        simulation.set_level(kind, cfg.friction_level)
    if command is not None:
        simulation.set_velocity(command.velocity)
    return simulation


def write_static(cfg: ViewCfg, path: Path, simulation: Simulation) -> int:
    """Write the static page."""
    from stiction.report.terminal import work_progress
    from stiction.view.server import serve
    from stiction.view.static import write_page

    with serve() as server, work_progress() as progress:
        write_page(server, simulation, path, cfg.seconds, cfg.dark, lambda share: progress("walking", share))
    print(f"page: {path}, {path.stat().st_size / 2**20:.1f} MiB")
    return 0


def show(cfg: ViewCfg, simulation: Simulation, runs: dict[int, NewestPolicy]) -> int:
    """Serve until a signal ends it."""
    from stiction.view.server import LOOPBACK, serve
    from stiction.view.viewer import Viewer

    with serve(cfg.port, cfg.host) as server:
        viewer = Viewer(server, simulation, cfg.out, cfg.dark, runs)
        host = server.get_host()
        if host != LOOPBACK:
            print("stiction view: everybody who reaches this address can look and steer; no password", file=sys.stderr)
        place = f"[{host}]" if ":" in host else host
        print(f"open http://{place}:{server.get_port()} in a browser; Ctrl-C ends it", flush=True)
        watchers = [run.watch(partial(viewer.refresh, number)) for number, run in runs.items() if cfg.follow]
        try:
            viewer.run()
        finally:
            for stop in watchers:
                stop()
            viewer.close()
    return 0
