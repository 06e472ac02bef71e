"""Tables of the paper's comparison: every way of training in every place, with intervals, and over stairs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from stiction.formats.friction import level_text
from stiction.formats.replication import BOTH, Sample
from stiction.report.sheet import Sheet

PLACES = {
    "mujoco": "MuJoCo, the simulator of the training",
    "mujoco-alone": "Sim2Sim: MuJoCo with one robot in it, motors and friction by us",
    "physx": "Sim2Sim: PhysX",
    "ode-webots": "Sim2Sim: ODE as Webots sets it up; not run in Webots",
    "ode": "Sim2Sim: ODE",
    "physx+all": "The virtual robot",
    "physx+friction": "The virtual robot's friction alone",
    "physx+rest": "All of the virtual robot but friction",
    "physx+nominal": "The virtual robot with nothing hidden",
}
"""Engine -> title of its table."""

COLUMNS = (
    ("vx=0.5", "speed_ratio", "forward", ".2f"),
    ("vx=-0.5", "speed_ratio", "backward", ".2f"),
    ("vy=0.3", "speed_ratio", "sideways", ".2f"),
    ("wz=0.5", "speed_ratio", "turn", ".2f"),
    (BOTH, "fall_rate", "falls", ".0%"),
    (BOTH, "joint_jitter", "jitter [rad/s²]", ".0f"),
    (BOTH, "flight_share", "flight", ".0%"),
    (BOTH, "tripod_share", "tripod", ".0%"),
    ("stand", "tracking_error", "standing [m/s]", ".3f"),
)
"""Command, column, heading, format."""

NOTE = (
    "Mean ± 95 % t-interval over training seeds; one seed has none. Forward to turn: speed reached over commanded. "
    "Falls to tripod: forward and backward together. Jitter: root mean square joint acceleration. In brackets behind a "
    "share of walks: Wilson's 95 % interval over trials, which are walks, and of virtual robots pairs of policy and "
    "robot: all policies share the robots, so it is too narrow for other robots. Every seed's number is in methods.csv."
)
"""What a reader of these tables must know."""


def friction_text(law: str, level: float) -> str:
    """Return friction as people read it: `20 %`, `c = 0.05`, `bench (1.07 %) and 0.1 of the load`."""
    base, _, load = law.partition("+load")
    text = level_text(base, round(level, 4)) if level else "none"
    text = f"bench ({text})" if base.endswith("-bench") else text
    return f"{text} and {load} of the load" if load else text


def place_sheets(samples: Sequence[Sample]) -> list[Sheet]:
    """Return a table of all ways at all levels for every engine and law on flat ground, known engines first.

    The laws of a virtual robot share one: they are its friction alone, of the bench, and with load.
    """
    groups: dict[tuple[str, str], list[Sample]] = {}
    for sample in samples:
        if sample.terrain == "flat":
            law = "" if "+" in sample.engine else sample.friction_law
            groups.setdefault((sample.engine, law), []).append(sample)
    rank = {engine: number for number, engine in enumerate(PLACES)}
    keys = sorted(groups, key=lambda key: rank.get(key[0], len(rank)))
    return [_place_sheet(_title(*key), groups[key]) for key in keys]


def _title(engine: str, law: str) -> str:
    """Return the title of a table."""
    title = PLACES.get(engine, engine)
    return title if law in ("", "coulomb") else f"{title}, friction by the law {law}"


def _place_sheet(title: str, own: Sequence[Sample]) -> Sheet:
    """Return one place: a row for every friction and way, the columns that somebody has."""
    cells = {(s.friction_law, s.friction_level, s.method, s.command, s.column): s for s in own}
    frictions = sorted({key[:2] for key in cells}, key=lambda one: (len(one[0]), one))
    ways = list(dict.fromkeys(s.method for s in own))
    columns = [one for one in COLUMNS if any((s.command, s.column) == one[:2] for s in own)]
    rows = []
    for law, level in frictions:
        for way in ways:
            shown = [cells.get((law, level, way, *column[:2])) for column in columns]
            if any(shown):
                texts = (sample_text(one, column[-1]) for one, column in zip(shown, columns, strict=True))
                rows.append((friction_text(law, level), way, seeds_text(shown), *texts))
    header = ("friction", "method", "seeds", *(heading for *_, heading, _ in columns))
    return Sheet(title, header, tuple(rows), NOTE)


def sample_text(sample: Sample | None, form: str) -> str:
    """Return a mean with its intervals, a dash where there is none."""
    if sample is None:
        return "–"
    text = format(sample.mean, form)
    if sample.high is not None:
        text += f" ± {format(sample.high - sample.mean, form)}"
    if sample.trials_low is not None and sample.trials_high is not None:
        text += f" ({sample.trials_low:.0%} to {sample.trials_high:.0%})"
    return text


def seeds_text(samples: Iterable[Sample | None]) -> str:
    """Return the number of training seeds behind samples."""
    counts = sorted({len(sample.seeds.split()) for sample in samples if sample is not None})
    return " or ".join("one" if count == 1 else str(count) for count in counts)


def stairs_sheet(samples: Sequence[Sample]) -> Sheet | None:
    """Return the crossings of every way of training; None where none was walked."""
    cells = {(s.method, s.engine, s.friction_law, s.friction_level, s.terrain, s.column): s for s in samples}
    rows = []
    for (way, engine, law, level, terrain, column), sample in cells.items():
        if column == "crossed":
            steps = cells.get((way, engine, law, level, terrain, "steps_climbed"))
            place = way, engine, friction_text(law, level), terrain, seeds_text([sample]), str(sample.trials)
            rows.append((*place, sample_text(sample, ".0%"), sample_text(steps, ".1f")))
    header = ("method", "engine", "friction", "ground", "seeds", "trials", "crossed", "steps passed")
    note = f"Blind, 0.30 m treads, six up, landing, six down, 0.4 m/s. {NOTE}"
    return Sheet("Stairs", header, tuple(rows), note) if rows else None
