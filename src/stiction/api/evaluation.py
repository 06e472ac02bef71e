"""Evaluate policies over engines, friction, grounds and commands: `stiction evaluate` in Python."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from stiction.api.options import options_of, public, several
from stiction.api.policy import LoadedPolicy
from stiction.api.result import Progress, Result, html_table, silent
from stiction.core.errors import ConfigurationError
from stiction.core.lock import output_folder
from stiction.core.records import header, texts
from stiction.core.scratch import scratch
from stiction.files.following import EVERY
from stiction.files.results import SCHEMA_VERSION, ResultRow, tell_slowest_walk

if TYPE_CHECKING:
    from stiction.evaluation.grid import GridCfg

OF_WALK = ("settle", "action_delay", "static_ratio", "stribeck_velocity", "known_friction")
"""Fields of `EvaluationCfg` that are options without a parameter of their own."""


@dataclass(frozen=True, repr=False)
class Evaluated(Result):
    """Results of an evaluation. Iterating gives the rows, as in `results.csv`."""

    rows: tuple[ResultRow, ...]
    """Rows, one per policy, engine, friction, ground and command: `speed_ratio`, `tracking_error` [m/s], ..."""
    summary: dict[str, Any]
    """Bundles, engines and settings of the evaluation, and the same rows with their spread; `summary.json`."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to read before a number is used, one sentence each."""
        return tuple(self.summary["warnings"])

    def __iter__(self) -> Iterator[ResultRow]:
        """Iterate over the rows."""
        return iter(self.rows)

    def __len__(self) -> int:
        """Return how many rows there are."""
        return len(self.rows)

    def columns(self) -> dict[str, list[Any]]:
        """Return column -> values, a value a row, for `pandas.DataFrame(result.columns())`."""
        return {name: [getattr(row, name) for row in self.rows] for name in ResultRow.__dataclass_fields__}

    def lines(self) -> Sequence[str]:
        """Return a line a policy, or how many there are: at which friction it follows which commands."""
        from stiction.report.evaluation import lead

        *policies, _ = lead(self.rows).split("\n")
        return [*policies[:3], *([f"and {len(policies) - 3} policies more"] if len(policies) > 3 else [])]

    def to_dict(self) -> dict[str, Any]:
        """Return what `stiction evaluate --json` prints, and `summary.json` holds."""
        return {"schema_version": SCHEMA_VERSION} | self.summary

    def table(self) -> Markup:
        """Return a row a condition; the last column is the slowest walk, where that is known."""
        from stiction.report.following import SLOWEST_WALK, result_cells

        first = ("policy", "engine", "friction", "terrain", "command")
        last = (SLOWEST_WALK,) if tell_slowest_walk(self.rows) else ()
        named = [(row.policy, row.engine, f"{row.friction_level:g}", row.terrain, row.command) for row in self.rows]
        rows = [
            (*name, *texts(row), *(result_cells(row)[column] for column in last))
            for name, row in zip(named, self.rows, strict=True)
        ]
        return html_table((*first, *header(ResultRow), *last), rows)

    def write(self, folder: Path) -> None:
        """Write results.csv, methods.csv, summary.json, the figures and report.html."""
        from stiction.evaluation.samples import samples_of
        from stiction.report.evaluation import write_evaluation

        ways = self.summary["ways"]
        write_evaluation(folder, list(self.rows), self.summary, samples_of(self.summary["rows"], ways) if ways else ())


@public
def evaluate(
    *policies: LoadedPolicy | str | Path | Callable[..., Any],
    robot: str | Path | None = None,
    callable_period: float = 0.02,
    friction_levels: float | Sequence[float] = (0.0, 0.1, 0.2),
    joints: Sequence[str | Path] = (),
    friction_law: str = "coulomb",
    commands: str | Sequence[str] = EVERY,
    engines: str | Sequence[str] = ("mujoco",),
    terrains: str | Sequence[str] = ("flat",),
    episodes: int = 8,
    seconds: float = 20.0,
    seed: int = 0,
    jobs: int | None = None,
    progress: Progress = silent,
    out: str | Path | None = None,
    **options: Any,
) -> Evaluated:
    """Drive policies over levels of dry joint friction, commands, grounds and physics engines. Needs the extra `sim`.

    Args:
        policies: from `load_policy`; the directory of a bundle, or a name of `list_policies`, which are checked first;
            or one function of your own, `function(sensors, command, fresh)` -> joint targets [rad], shape (N, J).
        robot: a robot of your own in the bundle's place, or that of the function; what `load_robot` takes.
        callable_period: time between two calls of the function [s].
        friction_levels: dry friction as fractions of each joint's torque limit.
        joints: `joints.json` files whose dry friction the joints have, in place of levels.
        friction_law: law of the dry friction, whatever the training's.
        commands: `vx=0.5` [m/s], `wz=0.3` [rad/s], `vx=0.3,wz=0.2`, `stand`; `all`: the fifteen to be followed.
        engines: `mujoco`, the simulator of the training; `mujoco-alone`, `physx`, `ode`; `physx+all` and so on.
        terrains: `flat`, `stairs=0.1`, `slope=0.2`, `rough=0.05`.
        episodes: a level and command.
        seconds: length of an episode [s]; its first 2 s are not measured.
        seed: of initial states and sensor noise.
        jobs: processes at once; by default one a core. They do not change the result.
        progress: called with the name of an engine and the share of its walks that is done.
        out: folder for results.csv, summary.json, report.html and walks.jsonl, by which an interrupted call goes on
            where it was; by default nothing is written.
        options: every other field of `GridCfg` and `EvaluationCfg`; the flags of the verb.

    Raises `StictionError`: a bundle is damaged, an engine is not installed, an option cannot be run.

    >>> import stiction
    >>> result = stiction.evaluate("saturn_lite-flat-none-0.2", friction_levels=[0.0], commands=["vx=0.5"], episodes=2,
    ...                            seconds=3.5, jobs=1)
    >>> result.rows[0].fall_rate
    0.0

    """
    from stiction.evaluation.evaluate import EvaluationCfg
    from stiction.evaluation.grid import GridCfg
    from stiction.report.terminal import jobs_of

    if not policies:
        raise ConfigurationError("evaluate: no policy; expected one of load_policy, list_policies, or a function")
    known = {name: options.pop(name) for name in list(options) if name in OF_WALK}
    walked: dict[str, Any] = {
        "friction_levels": several(friction_levels),
        "friction_law": friction_law,
        "commands": several(commands),
    }
    walked |= {"episodes": episodes, "seconds": seconds, "seed": seed}
    base = options_of(EvaluationCfg, known | walked, evaluate)
    asked = options | {"engines": several(engines), "terrains": several(terrains)}
    cfg = replace(options_of(GridCfg, asked, evaluate), base=base)
    named = None if robot is None else str(robot)
    work, files = None if out is None else Path(out), [Path(file) for file in joints]
    return _walk(policies, cfg, named, callable_period, jobs_of(jobs), progress, work, files)


def _walk(
    policies: Sequence[Any],
    cfg: GridCfg,
    robot: str | None,
    period: float,
    jobs: int,
    progress: Progress,
    out: Path | None,
    joints: Sequence[Path],
) -> Evaluated:
    """Walk the grid, in a folder of which nothing is left where none is asked for; see `evaluate`."""
    from stiction.evaluation.benches import as_identified
    from stiction.evaluation.summary import bundle_of, evaluate_all

    # A bundle that was checked is not read again: what is evaluated is what was hashed.
    resolved = [
        one.bundle if isinstance(one, LoadedPolicy) else one if callable(one) else Path(one) for one in policies
    ]
    bundles = [bundle_of(policy, cfg, robot, period) for policy in resolved]
    cfg, notes = as_identified(cfg, bundles, joints) if joints else (cfg, ())
    if any(callable(policy) for policy in policies):
        jobs = 1  # the function is in this process
    with scratch() if out is None else nullcontext(out) as work, output_folder(work):
        rows, summary = evaluate_all(bundles, cfg, work, robot, jobs, progress)
        summary["warnings"] += notes
        result = Evaluated(tuple(rows), {"command": "stiction.evaluate(...)"} | summary)
        if out is not None:
            result.write(out)
    return result


__all__ = ["Evaluated", "evaluate"]
