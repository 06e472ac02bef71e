"""`stiction view POLICY...`: watch policies walk side by side in the browser, and turn their joints' friction up."""

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
    from stiction.view.viewer import Viewer

DESCRIPTION = """Watch policies walk in the browser, and turn their joints' dry friction up while they do.

Each bundle, or newest checkpoint of a training run, walks on a robot of its own, all from one start line, under one
command. Sliders and keys set command, friction of each kind of joint, wear, pushes, ground and engine; plots show the
speed beside the command, the torque of one joint, and what the walk tells of the friction beside the true one.

Examples:
  stiction view
  stiction view saturn_lite-flat-none-0.2 saturn_lite-flat-deception-0.2 --command vx=0.5 --friction-level 0.2
  stiction view runs/first --follow
  stiction view BUNDLE --static page.html --seconds 10 --command vx=0.5

The first line shows three shipped policies: trained without friction, at one level, and over a range. The address is
printed; Ctrl-C ends it. Nobody but this machine can look, unless --host names another address. While no browser looks,
time stands still. From another machine: ssh -L 8080:127.0.0.1:8080 THIS-MACHINE."""

SHIPPED = ("saturn_lite-flat-none-0.2", "saturn_lite-flat-direct-0.2", "saturn_lite-flat-deception-0.2")
"""Policies that are shown where none is named."""

POLITE = 10
"""Nice value beside a training, which comes first."""


@dataclass(frozen=True)
class ViewCfg:
    """Options of the verb."""

    policies: Annotated[tuple[Path, ...], ARGUMENT] = ()
    """Directories of bundles, names of bundles that come with the package, or training runs (extra train)."""
    command: str = "stand"
    """Velocity at the beginning, vx forward, vy sideways [m/s], wz turn [rad/s]: vx=0.5, or vx=0.3,wz=0.2, or stand."""
    friction_level: float = 0.0
    """Dry friction at the beginning, as a fraction of each joint's torque limit [-]; of the laws load and effort, the
    coefficient."""
    friction_law: Annotated[str, law_flag("Law of the dry friction, whatever the training's.")] = "coulomb"
    engine: str = "mujoco"
    """Physics engine at the beginning: mujoco, physx, ode, ode-webots, or package.module:ENGINE of your own."""
    terrain: str = "flat"
    """Ground at the beginning: flat, stairs=0.1 (step height [m]), slope=0.2 (angle [rad]), rough=0.05 (highest
    slab [m]). What is not flat is crossed straight on, unless told to turn."""
    robot: str | None = None
    """A robot of your own, `package.module:NAME` or its file; by default the one that the bundle names."""
    seed: int = 0
    """Of sensor noise, and of the slabs of rough ground."""
    port: int | None = None
    """Port to listen on; by default the first free one from 8080 on."""
    host: str = "127.0.0.1"
    """Name or address to listen on; by default this machine's own, which nobody else reaches. Browsers have to use the
    same one, or localhost. There are no passwords."""
    dark: bool = False
    """Draw dark."""
    follow: bool = False
    """Of a training run that goes on: show each new checkpoint, and wait for the first."""
    out: Path = Path("stiction-view")
    """Folder for recordings: canonical logs, NPZ, made when first needed."""
    static: Path | None = field(default=None, metadata=excludes("--port", "--host", "--follow", "--out"))
    """Write an HTML file that needs no server, of --seconds at --command and --friction-level, and end."""
    overwrite: bool = field(default=False, metadata=needs("--static"))
    """Write over a file that is there."""
    seconds: float = field(default=10.0, metadata=needs("--static"))
    """Length of what is written with --static [s]."""


def main(arguments: list[str]) -> int:
    """Run the verb; return the exit status."""
    cfg = read_options(ViewCfg, arguments, "stiction view", DESCRIPTION)
    if not 0 < cfg.seconds <= 120:
        raise ConfigurationError(f"--seconds {cfg.seconds:g}; expected more than 0 and at most 120")
    if cfg.static is not None:
        check_file(cfg.static, cfg, "--static")  # before the robots are made ready
    else:
        from stiction.view.server import check_port, resolve

        # Before the robots are made ready.
        check_port(cfg.port)
        resolve(cfg.host)
    policies, robot, newest = policies_of(cfg)
    simulation = simulation_of(cfg, policies, robot)
    if cfg.static is not None:
        return write_static(cfg, cfg.static, simulation)
    if cfg.follow:
        os.nice(POLITE)
    try:
        return show(cfg, simulation, newest)
    except KeyboardInterrupt:
        # The way in which a viewer ends.
        return 0


def policies_of(cfg: ViewCfg) -> tuple[list[ViewedPolicy], Robot, dict[int, NewestPolicy]]:
    """Return what is looked at, its robot, and by its number what may be replaced by a newer checkpoint."""
    from stiction.deploy.check import check_for_simulation, record_notes
    from stiction.files.bundle import find_bundle
    from stiction.files.contract import robot_of
    from stiction.report.terminal import print_warnings
    from stiction.view.simulation import ViewedPolicy

    policies: list[ViewedPolicy] = []
    folders: list[str] = []
    robots: list[Robot] = []
    newest: dict[int, NewestPolicy] = {}
    for number, path in enumerate(cfg.policies or map(Path, SHIPPED)):
        if (path / "config.json").is_file():
            from stiction.evaluation.newest import NewestPolicy

            run = newest[number] = NewestPolicy(path, wait=cfg.follow, robot=cfg.robot)
            policies.append(viewed(run))
            robots.append(run.robot)
            folders.append(path.resolve().name)
        else:
            bundle = check_for_simulation(find_bundle(path))
            print_warnings("view", record_notes([bundle]))
            policies.append(ViewedPolicy.of_bundle(bundle))
            robots.append(robot_of(bundle.contract, cfg.robot))
            folders.append(bundle.name)
    if cfg.follow and not newest:
        raise ConfigurationError("--follow is for a training run, which grows; a bundle stays what it is")
    names = [policy.name for policy in policies]
    for number, name in enumerate(names):
        # Two runs may stand at the same iteration, and are told apart by their folders.
        if names.count(name) > 1:
            policies[number] = replace(policies[number], name=f"{folders[number]}: {name}")
    return policies, robots[0], newest


def simulation_of(cfg: ViewCfg, policies: list[ViewedPolicy], robot: Robot) -> Simulation:
    """Return the simulation as it begins."""
    from stiction.core.records import part_of
    from stiction.evaluation.course import parse_course, untrained
    from stiction.files.velocity import parse_command
    from stiction.joints.friction import MAX_LEVEL, Law
    from stiction.view.simulation import Simulation, WorldCfg

    if not 0 <= cfg.friction_level <= MAX_LEVEL:
        meant = if_per_cent(cfg.friction_level)
        raise ConfigurationError(f"--friction-level {cfg.friction_level:g}; expected 0 to {MAX_LEVEL:g}{meant}")
    command = parse_command(cfg.command)
    for policy in policies:
        if said := untrained([command], policy.contract):
            raise ConfigurationError(f"{policy.name!r}: {said}; command less")
    world = part_of(WorldCfg, cfg, course=parse_course(cfg.terrain), law=Law(cfg.friction_law))
    simulation = Simulation(policies, robot, world)
    for kind in simulation.kinds:
        simulation.set_level(kind, cfg.friction_level)
    simulation.set_velocity(command.velocity)
    return simulation


def write_static(cfg: ViewCfg, path: Path, simulation: Simulation) -> int:
    """Write the page that needs no server."""
    from stiction.report.terminal import work_progress
    from stiction.view.scene import write_page
    from stiction.view.server import serve

    with serve() as server, work_progress() as progress:
        write_page(server, simulation, path, cfg.seconds, cfg.dark, lambda share: progress("walking", share))
    print(f"page: {path}, {path.stat().st_size / 2**20:.1f} MiB")
    return 0


def viewed(run: NewestPolicy) -> ViewedPolicy:
    """Return the newest checkpoint of a run as what is looked at."""
    from stiction.view.simulation import ViewedPolicy

    return ViewedPolicy(run.name, run.contract, run.load)


def _teach(viewer: Viewer, number: int, run: NewestPolicy) -> None:
    """Give a robot the newest checkpoint of its run."""
    viewer.submit(lambda: viewer.teach(number, viewed(run)))


def show(cfg: ViewCfg, simulation: Simulation, newest: dict[int, NewestPolicy]) -> int:
    """Serve until somebody ends it."""
    from stiction.view.server import LOOPBACK, serve
    from stiction.view.viewer import Viewer

    with serve(cfg.port, cfg.host) as server:
        viewer = Viewer(server, simulation, cfg.out, cfg.dark)
        host = server.get_host()
        if host != LOOPBACK:
            print(
                "stiction view: whoever reaches this address can look and steer; there is no password", file=sys.stderr
            )
        place = f"[{host}]" if ":" in host else host
        print(f"open http://{place}:{server.get_port()} in a browser; Ctrl-C ends it", flush=True)
        watchers = [run.watch(partial(_teach, viewer, number, run)) for number, run in newest.items() if cfg.follow]
        try:
            viewer.run()
        finally:
            for stop in watchers:
                stop()
            viewer.close()
    return 0
