"""`stiction bench`: the ratios that say how much of the simulator's speed the training keeps."""

from __future__ import annotations

import json
import shlex
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from stiction.core.effects import excludes, needs
from stiction.core.errors import ConfigurationError
from stiction.core.options import read_options
from stiction.learning.config import DeviceName
from stiction.learning.presets import PresetName, preset
from stiction.task.friction import law_flag
from stiction.task.terrain import TerrainName

if TYPE_CHECKING:
    from rich.table import Table

DESCRIPTION = """Measure throughput side by side in one run, on all cores (or STICTION_THREADS).

rollout_ratio: env-steps/s of the task, with observations, rewards, resets and randomisation, over the bare simulator
that replays the same states and controls on the same threads, with the per-robot parameters that stand at the end of
each block. iteration_ratio: a whole iteration of training, likewise. parts: the CPU seconds of an iteration, physics,
task, inference, PPO, supervised pass, for each way to simulate joint friction, in turn, and their ratios to bare
physics of the same kind. Also the deployed policy's step, and an identification. On other devices than the processor
there are env-steps/s, and no ratios.

Examples:
  stiction bench
  stiction bench --robot go2 --method none --json"""


@dataclass(frozen=True)
class Bench:
    """Options of `stiction bench`."""

    preset: PresetName = "quick"
    """Preset, as in `stiction train`: one phase, or the teacher's of two phases."""
    method: Literal["none", "direct", "deception"] = "deception"
    """Friction in the joints during the measurement: rows of dry friction cost the simulator half its speed."""
    friction_level: float = field(default=0.2, metadata=needs("--method direct or deception"))
    """Nominal friction, as a fraction of the torque limit, or the coefficient of the law."""
    friction_law: Annotated[str, law_flag("All but coulomb stop the simulator at every step.")] = "coulomb"
    robot: str = "saturn_lite"
    """The robot to measure with."""
    terrain: TerrainName = "flat"
    """Terrain; elevation map and courses take more time than flat ground."""
    actuator: Path | None = None
    """A folder of `stiction train-actuator`: its net gives the torque in the task. With one of output-side torque, use
    --method none."""
    num_envs: int = 512
    """Robots side by side."""
    device: DeviceName = "cpu"
    """Compute device, as in `stiction train`."""
    blocks: int = 8
    """Paired blocks; the figures are medians over them."""
    ground: bool = field(
        default=False,
        metadata=excludes(but=("--robot", "--num-envs", "--blocks", "--json")),
    )
    """Measure boxes against height fields for the same stairs, and nothing else."""
    json: bool = False
    """Print the summary as JSON on standard output, and nothing else."""


def main(arguments: list[str]) -> int:
    """Run the verb."""
    options = read_options(Bench, arguments, "stiction bench", DESCRIPTION)
    if options.blocks < 1 or options.num_envs < 1:
        raise ConfigurationError(f"{options.blocks} blocks of {options.num_envs} robots: expected at least one of each")
    if options.ground:
        return _measure_ground(options)
    from dataclasses import asdict, replace

    from stiction.core.provenance import Origin
    from stiction.files.actuator import read_actuator
    from stiction.report.terminal import Terminal
    from stiction.robots.catalog import find_robot
    from stiction_experiments.throughput.measure import measure_parts, measure_training, parts_summary

    # Refused before anything is measured.
    spec = find_robot(options.robot)
    note, origin = Terminal(stderr=True, quiet=options.json), Origin.now()
    cfg = replace(preset(options.preset, options.device), num_envs=options.num_envs)
    level, law = options.friction_level, options.friction_law
    friction = replace(cfg.task.friction, method=options.method, level=level, law=law)
    terrain = replace(cfg.task.terrain, kind=options.terrain)
    # The rewards that a training of this robot has: one without contact groups is not paid for a trot.
    rewards = cfg.task.rewards.for_robot(spec)
    task = replace(cfg.task, robot=options.robot, friction=friction, terrain=terrain, rewards=rewards)
    cfg = replace(cfg, device=options.device, task=task)
    net = None if options.actuator is None else read_actuator(options.actuator)
    note.print("task against bare simulator ...")
    timing, sizes = measure_training(cfg, options.blocks, net)
    parts = None
    if options.device == "cpu":
        note.print("where the time goes ...")
        parts = parts_summary(measure_parts(cfg, options.blocks, net))
    note.print("deployed policy and identification ...")
    summary = {
        **timing.summary(),
        "measured": {
            "preset": options.preset,
            "robot": options.robot,
            "method": options.method,
            "friction_law": options.friction_law,
            "physics": asdict(cfg.task.physics),
            "friction_level": options.friction_level,
            "terrain": options.terrain,
            "actuator": None if options.actuator is None else options.actuator.resolve().name,
            "num_envs": options.num_envs,
            "device": options.device,
            "steps_per_block": cfg.teacher.steps,
            "blocks": options.blocks,
        },
        "parts": parts,
        "multiply_adds_per_env_step": sizes,
        "policy_step_ms": _policy_step(),
        "identification_seconds": _identification(),
        "command": shlex.join(["stiction", "bench", *arguments]),
        **origin.provenance,
    }
    if options.json:
        print(json.dumps(summary))
    else:
        _show(summary)
    return 0


def _measure_ground(options: Bench) -> int:
    """Measure and print the speed of the simulator alone on stairs of boxes and of height fields."""
    from stiction.core.provenance import Origin, num_threads
    from stiction.robots.catalog import find_robot
    from stiction_experiments.throughput.measure import measure_grounds

    origin = Origin.now()
    measured = measure_grounds(find_robot(options.robot), options.num_envs, options.blocks, num_threads())
    if options.json:
        print(json.dumps(measured | origin.provenance))
        return 0
    for name, ratio in measured["over_plane"].items():
        low, high = measured["spread"][name]
        rate = measured["control_steps_per_second"][name]
        print(f"{name:<28}{rate:>8.0f} control steps/s   {ratio:.2f} of the plane's ({low:.2f} to {high:.2f})")
    return 0


def _policy_step() -> dict[str, float] | None:
    """Time the first shipped policy, or return None where none came along."""
    from stiction.files.bundle import shipped_bundles
    from stiction_experiments.throughput.measure import measure_runtime

    paths: list[Path] = list(shipped_bundles().values())
    return measure_runtime(paths[0]) if paths else None


def _identification() -> float:
    """Time the identification of the example log, estimators and intervals, without the page [s]."""
    from stiction.identification.example import example_log
    from stiction.identification.pipeline import identify_joint

    log = example_log()
    start = time.perf_counter()
    identify_joint(log)
    return time.perf_counter() - start


def _show(summary: dict) -> None:
    from rich.table import Table

    from stiction.report.terminal import Terminal

    table = Table("what", "median", "min to max")
    for name, spread in summary["spread"].items():
        table.add_row(name, f"{spread['median']:.3f}", f"{spread['min']:.3f} to {spread['max']:.3f}")
    for name, spread in summary["env_steps_per_second"].items():
        table.add_row(
            f"{name}, env-steps/s", f"{spread['median']:,.0f}", f"{spread['min']:,.0f} to {spread['max']:,.0f}"
        )
    for name, count in summary["multiply_adds_per_env_step"].items():
        table.add_row(f"multiply-adds, {name}", f"{count:,}", "")
    step = summary["policy_step_ms"]
    if step is None:
        table.add_row("policy step", "-", "no policy is shipped with this installation")
    else:
        table.add_row("policy step, ms", f"{step['p50']:.3f}", f"p99 {step['p99']:.3f}, max {step['max']:.3f}")
    table.add_row("identification, s", f"{summary['identification_seconds']:.2f}", "example log, one joint")
    console = Terminal()
    console.print(table)
    if summary["parts"] is not None:
        console.print(_parts_table(summary["parts"]))
    facts = summary["machine"]
    software = f"{facts['threads']} threads, matrix products {facts['gemm']}, Python {facts['python']}"
    console.print(f"{facts['cpu']}, {software}, revision {summary['revision']}")


def _parts_table(parts: dict[str, dict[str, float]]) -> Table:
    """Return the parts of an iteration as a table, a column for each physics."""
    from rich.table import Table

    table = Table("CPU s of an iteration", *parts)
    for name in next(iter(parts.values())):
        table.add_row(name.replace("_", " "), *(f"{column[name]:.3f}" for column in parts.values()))
    return table
