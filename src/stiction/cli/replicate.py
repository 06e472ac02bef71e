"""`stiction replicate`: the paper's comparison, and what a user would try, in other engines and on a virtual robot."""

from __future__ import annotations

import hashlib
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from stiction.cli.jobs import jobs_of
from stiction.formats.errors import StictionError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from stiction.formats.bundle import Bundle
    from stiction.formats.replication import Replication
    from stiction.report.replication_clips import ClipPair
    from stiction.transfer.experiment.manifest import Run

DESCRIPTION = """The paper's comparison as one command, resumable: conventional, Actuator Net and friction-aware
training, the paper's other ways, and what a user would try; in other physics engines, on a virtual robot with joints of
its own, on flat ground and stairs. Each sentence of the paper gets a verdict with its numbers.

quick: the shipped policies, some ten minutes on two cores. They have one training seed a way: numbers, no verdicts. A
verdict takes several training seeds of every way that a sentence compares: give bundles or runs of each seed with
--policies, or --preset full, which trains what is missing first (days on two cores): three seeds or more of every way
on flat ground, and of two ways over stairs; none of an Actuator Net over stairs, so that E9 is not tested. A training
that fails is named and left out, and the exit status is 1. Stop it at any time: the same command goes on; a walk in
progress, or a bench of some minutes, is begun anew."""

CLIPS = ("none", "actuator", "direct", "deception")
"""Ways of training that are shown, each in the simulator of the training and on a virtual robot."""

ROBOT = "saturn_lite"
"""The paper's robot: engines are tried with it before anything is trained."""

CLIP_LEVEL, CLIP_COMMAND = 0.2, "vx=0.5"


@dataclass(frozen=True)
class ReplicateCfg:
    """Options of `stiction replicate`."""

    preset: Literal["quick", "full"] = "quick"
    """quick: few levels, episodes and robots, one training seed a way, no verdicts; full: all of them, and policies
    that are trained for it."""
    policies: tuple[Path, ...] = ()
    """Bundles, names of shipped ones, or finished training runs; by default the shipped bundles (quick), or the runs
    of the experiment (full)."""
    runs: Path = Path("runs")
    """Folder of the training runs of the preset `full`, as `stiction study friction` has it."""
    parts: tuple[str, ...] = ()
    """Parts to walk: training, engines, robot, standing, causes, forward, stairs, stairs-robot, load, effort; by
    default all. Of the others, what --out has from before is judged too; where preset, policies or code are others,
    that is refused."""
    num_robots: int | None = None
    """How many virtual robots, seeds from 1000; by default 2 (quick) or 8 (full), over stairs 16."""
    jobs: int | None = None
    """Walks, or trainings, at once, each on one thread; by default as many as there are cores (STICTION_THREADS)."""
    judge_again: bool = False
    """Walk and train nothing: judge what --out has by today's criteria, and draw its page anew, with the clips of those
    --policies that walked."""
    clips: bool = True
    """Render clips: of four methods one each in the simulator of the training, and one on a virtual robot."""
    out: Path | None = None
    """By default stiction-replication-quick, or -full. Folder of results.csv, methods.csv, budget.csv, forward.csv,
    onsets.csv, following.csv, verdicts.csv, evidence.csv, summary.json, tables.md, figures, clips, report.html, and a
    folder for each part, by which an interrupted command goes on."""
    advice: Path | None = None
    """Also write who follows into this file of what `stiction identify` advises by."""
    json: bool = False
    """Print the verdicts as JSON on standard output, and nothing else."""

    def __post_init__(self) -> None:
        """Refuse no robots."""
        if self.num_robots is not None and self.num_robots < 1:
            raise StictionError(f"--num-robots {self.num_robots}: expected at least 1")


def main(arguments: list[str]) -> int:
    """Walk the comparison, judge it, write the page; return 1 if a run could not be trained."""
    cfg = tyro.cli(ReplicateCfg, args=arguments, prog="stiction replicate", description=DESCRIPTION)
    jobs = jobs_of(cfg.jobs)
    import json
    from dataclasses import replace

    from stiction.cli.terminal import print_warnings, work_progress
    from stiction.formats.folder import make_folder
    from stiction.formats.origin import Origin
    from stiction.report.replication import lead, warnings, write_replication
    from stiction.robots.catalog import find_robot
    from stiction.transfer.replication.again import judge_again
    from stiction.transfer.replication.plan import parts_of
    from stiction.transfer.replication.run import check_engines, replicate

    parts = parts_of(cfg.preset, cfg.num_robots)
    names = [part.name for part in parts]
    if unknown := [name for name in cfg.parts if name not in names]:
        raise StictionError(f"part {unknown[0]!r} is none of the comparison's; expected some of {', '.join(names)}")
    asked = cfg.parts or names
    if not cfg.judge_again:
        check_engines([part for part in parts if part.name in asked], find_robot(ROBOT))
    out = cfg.out or Path(f"stiction-replication-{cfg.preset}")
    make_folder(out)
    origin = Origin.now()
    with work_progress() as progress:
        found = find_policies(cfg, out, jobs, progress)
        if isinstance(found, int):
            return found
        bundles, folders, failed = found
        command = shlex.join(["stiction", "replicate", *arguments])
        made = {"command": command, **origin.provenance}
        if cfg.judge_again:
            result = judge_again(out, made)
        else:
            made |= {"preset": cfg.preset, "failed": failed}
            result = replicate(bundles, parts, out, jobs, progress, made, asked)
    result = replace(result, summary=result.summary | {"warnings": origin.warnings()})
    if cfg.advice is not None:
        advise(cfg.advice, result)
    walked = result.summary["policies"]
    bundles = [one for one in bundles if walked.get(one.name, {}).get("digest") == one.digest]
    clips = render(bundles, folders, out) if cfg.clips else []
    page = write_replication(out, result, clips)
    print_warnings("replicate", warnings(result))
    if cfg.json:
        print(json.dumps({verdict.id: verdict.outcome for verdict in result.verdicts}))
    else:
        print(f"{lead(result)}\nreport: {page}")
    return 1 if failed else 0


def advise(path: Path, result: Replication) -> None:
    """Write the comparison's part of what `stiction identify` advises by."""
    from stiction.formats.advice import TRANSFER, write_source
    from stiction.transfer.replication.advice import source_of

    write_source(path, TRANSFER, source_of(result))


def find_policies(
    cfg: ReplicateCfg, out: Path, jobs: int, progress: Callable[[str, float], None]
) -> tuple[list[Bundle], dict[str, Path], dict[str, str]] | int:
    """Return the checked policies, the folder of each, and why others could not be trained.

    Or the exit status of a training that was asked to stop.
    """
    from stiction.deploy.check import check_bundle
    from stiction.formats.shipped import find_bundle, shipped_bundles

    given = [find_bundle(path) for path in cfg.policies] or list(shipped_bundles().values())
    failed: dict[str, str] = {}
    if cfg.preset == "full" and not cfg.policies and not cfg.judge_again:
        trained = train_all(cfg, jobs, progress)
        if isinstance(trained, int):
            return trained
        given, failed = trained
    folders = export_all(given, out, jobs, progress)
    bundles = [check_bundle(folder).bundle for folder in folders]
    return bundles, {bundle.name: folder for bundle, folder in zip(bundles, folders, strict=True)}, failed


def export_all(given: Sequence[Path], out: Path, jobs: int, progress: Callable[[str, float], None]) -> list[Path]:
    """Return the folder of each bundle, of a training run what is exported of it into `out`; `jobs` at once."""
    from stiction.transfer.workers import spread

    folders = list(given)
    runs = [number for number, path in enumerate(given) if (path / "checkpoints").is_dir()]
    tasks = [(given[number], out) for number in runs]
    for done, (task, folder) in enumerate(spread(exported, tasks, jobs), start=1):
        folders[runs[task]] = folder
        progress("export", done / len(tasks))
    return folders


def exported(run: Path, out: Path) -> Path:
    """Return the bundle of a training run, exported into `out` where it is not there yet: that takes some seconds."""
    from stiction.formats.folder import make_folder
    from stiction.formats.reproducibility import made_by
    from stiction.rma.run import RunDirectory
    from stiction.transfer.export import export_run

    directory = RunDirectory(run)
    directory.check_finished("student")
    code = made_by("transfer/export.py", "transfer/golden.py", "formats/contract.py")
    made_from = repr((directory.student_digest(), code))
    folder = out / "bundles" / hashlib.sha256(made_from.encode()).hexdigest()[:12] / run.resolve().name
    if not folder.exists():
        make_folder(folder.parent)
        export_run(run, folder)
    return folder


def train_all(
    cfg: ReplicateCfg, jobs: int, progress: Callable[[str, float], None]
) -> tuple[list[Path], dict[str, str]] | int:
    """Train everything that is missing; return the folders of the finished runs, and why the others are not finished.

    Or the exit status if asked to stop. A run that fails stops nobody: what is finished is walked.

    Raises:
        StictionError: no run is finished, or a folder holds another run.

    """
    from stiction.cli.interruption import stop_requests
    from stiction.cli.train import parse
    from stiction.transfer.experiment.places import Place
    from stiction.transfer.experiment.training import train_missing
    from stiction.transfer.replication.runs import comparison_runs

    folders: list[Path] = []
    failed: dict[str, str] = {}

    def trained(runs: Sequence[Run]) -> int:
        places = [Place(run, parse([*run.arguments]).config, cfg.runs / run.name) for run in runs]
        with stop_requests(say, "an iteration of each run") as asked:
            failed.update(train_missing(places, jobs, progress, asked=asked))
        folders.extend(place.path for place in places if place.run.name not in failed)
        return asked.status if asked() else 0

    runs = cfg.runs.resolve()
    if status := trained(comparison_runs(known_joints(runs, jobs, progress))):
        return status
    if status := trained(loop_runs(runs, failed, jobs, progress)):
        return status
    for name, reason in failed.items():
        say(f"{name} is left out: {reason}")
    if not folders:
        raise StictionError(f"none of the {len(failed)} runs in {cfg.runs} could be trained; the reasons are above")
    return folders, failed


def loop_runs(runs: Path, failed: dict[str, str], jobs: int, progress: Callable[[str, float], None]) -> list[Run]:
    """Return the runs with an Actuator Net, and add to `failed` why one has no net: its f0 failed, or does not walk."""
    from stiction.transfer.replication.runs import LOOP_SEEDS, actuator_run, first_policy

    found = []
    for seed in LOOP_SEEDS:
        first, name = first_policy(seed), actuator_run(runs, seed).name
        if first in failed:
            failed[name] = f"{first} failed, whose walk its Actuator Net is of"
            continue
        try:
            found.append(actuator_run(known_net(runs, runs / first, jobs, progress), seed))
        except StictionError as error:
            failed[name] = str(error)
    return found


def known_joints(runs: Path, jobs: int, progress: Callable[[str, float], None]) -> Path:
    """Return the `joints.json` of the robot that training knows, identified on its bench where that is not done yet."""
    from stiction.robots.catalog import find_robot
    from stiction.transfer.replication.runs import known_bench
    from stiction.transfer.robot.identification import JOINTS, is_made, make_bench

    bench = known_bench(find_robot(ROBOT))
    folder = runs / "bench" / bench.label
    if not is_made(bench, folder):
        progress("bench", 0.0)
        make_bench(bench, folder, jobs)
        progress("bench", 1.0)
    return folder / JOINTS


def known_net(runs: Path, conventional: Path, jobs: int, progress: Callable[[str, float], None]) -> Path:
    """Return the folder of the Actuator Net of that robot, fitted to its walks where that is not done yet.

    conventional: the run of f0, which walks.
    """
    from stiction.deploy.check import check_bundle
    from stiction.robots.catalog import find_robot
    from stiction.transfer.replication.net import make_net
    from stiction.transfer.replication.runs import walked_net

    policy = check_bundle(exported(conventional, runs)).bundle
    walked = walked_net(find_robot(ROBOT), policy)
    folder = runs / "nets" / walked.label
    make_net(walked, folder, "stiction replicate --preset full", jobs, progress)
    return folder


def render(bundles: list[Bundle], folders: dict[str, Path], out: Path) -> list[ClipPair]:
    """Render clips of the first policy of each of `CLIPS`; without OpenGL or PhysX say so once and go on."""
    from stiction.report.replication_clips import ClipPair
    from stiction.robots.catalog import find_robot
    from stiction.transfer.clip import ClipError, record_clip
    from stiction.transfer.engines.catalog import what_is_missing
    from stiction.transfer.replay import ENGINE
    from stiction.transfer.robot.seeds import FIRST_REPORTED
    from stiction.transfer.ways import way_of

    if why := what_is_missing(ENGINE, find_robot(ROBOT)):
        say(f"no clips on the virtual robot: {why}")
    clips: list[ClipPair] = []
    for way in CLIPS:
        name = next((b.name for b in bundles if way_of(b.contract) == way and b.contract.terrain == "flat"), None)
        if name is not None:
            asked = folders[name], CLIP_LEVEL, CLIP_COMMAND
            try:
                trained = record_clip(*asked, out / f"{name}.webp")
                robot = None if why else record_clip(*asked, out / f"{name}-robot.webp", robot=FIRST_REPORTED)
            except ClipError as error:
                say(str(error))
                return clips
            clips.append(ClipPair(way, name, trained, robot))
    return clips


def say(text: str) -> None:
    """Print a line on standard error."""
    print(f"stiction replicate: {text}", file=sys.stderr)
