"""The answer of the experiment on training with friction, to be read aloud, and what its page asks."""

from __future__ import annotations

from collections.abc import Sequence

from stiction.files.method import find_method
from stiction.joints.friction import level_text
from stiction.report.following import places_text
from stiction_experiments.friction.manifest import TWO_PHASE
from stiction_experiments.friction.planned import EVALUATED
from stiction_experiments.friction.records import HIGHEST, STUDENT, Experiment, short_name
from stiction_experiments.lab.claims import said_of
from stiction_experiments.lab.following import has_one_seed
from stiction_experiments.lab.straight import Following

TITLES = {
    "designs": "Can one student follow without friction and with a lot of it?",
    "methods": "Do other ways to learn cope with joint friction?",
}
"""Part that is compared -> what its page asks."""

MOST = f"{100 * HIGHEST:g} %"
"""The highest friction of the tables, as people read it."""


def compared(experiment: Experiment) -> list[str]:
    """Return the conditions to set side by side: of the first part, else designs and methods that walked."""
    if first := [condition.name for condition in experiment.conditions if condition.part == "1"]:
        return first
    walked = {mean.condition for mean in experiment.means}
    parts = ("designs", "methods")
    return [one.name for one in experiment.conditions if one.part in parts and one.name in walked]


def has_claims(experiment: Experiment) -> bool:
    """Return whether the paper's sentences belong on the page: designs and methods test none of them."""
    return any(one.outcome != "not tested" for one in experiment.verdicts) or not compared(experiment)


def question(experiment: Experiment) -> str:
    """Return what the page asks."""
    parts = {condition.name: condition.part for condition in experiment.conditions}
    part = next((parts[name] for name in compared(experiment)), "1")
    phases = "two phases" if experiment.summary.get("preset", TWO_PHASE) == TWO_PHASE else "one phase"
    return TITLES.get(part, f"Which training in {phases} copes with how much joint friction?")


def lead(experiment: Experiment) -> str:
    """Return who follows where, how many sentences came out how, and how far it has come."""
    finished = sum(run.state in EVALUATED for run in experiment.runs)
    lines = [f"{finished} of {len(experiment.runs)} trainings are finished."]
    if not experiment.verdicts:
        return lines[0]
    walked = [name for name in compared(experiment) if _cells(experiment, name)]
    if has_claims(experiment):
        lines.insert(0, said_of(experiment.verdicts, "sentences of the paper on training with friction"))
    if walked:
        lines.insert(0, (_methods_answer if _is_first(experiment) else _ways_answer)(experiment, walked))
    return "\n".join(lines)


def _is_first(experiment: Experiment) -> bool:
    return any(condition.part == "1" for condition in experiment.conditions)


def _methods_answer(experiment: Experiment, conditions: Sequence[str]) -> str:
    """Return where every seed of the training methods follows, to be read aloud; those that never do come last."""
    how, single = named(experiment), _with_one_seed(experiment, conditions)
    alone = {name: ", its one seed" if name in single and len(single) < len(conditions) else "" for name in conditions}
    phrases = [f"{how[name]}{alone[name]}, {_where_all_follow(experiment, name)}" for name in conditions]
    listed = "; ".join(sorted(phrases, key=lambda one: one.endswith("nowhere")))
    seeds = "the one seed of each" if len(single) == len(conditions) else "every seed"
    return f"With this much friction, of each joint's torque limit, {seeds} follows: {listed}."


def _with_one_seed(experiment: Experiment, conditions: Sequence[str]) -> list[str]:
    """Return the conditions of which one seed walked: it is not every seed."""
    return [name for name in conditions if has_one_seed(_cells(experiment, name))]


def named(experiment: Experiment) -> dict[str, str]:
    """Return what each condition is, in words that stand alone: `trained without friction (none)`."""
    words = _purposes(experiment)
    for condition in experiment.conditions:
        name = short_name(condition.name)
        if condition.part == "1":
            low, high = (100 * condition.nominal * end for end in find_method(name).friction_range)
            words[condition.name] = f"trained with {low:g} to {high:g} %" if high else "trained without friction"
        words[condition.name] += f" ({name})"
    return words


def _ways_answer(experiment: Experiment, conditions: Sequence[str]) -> str:
    """Return how many designs or methods follow at every friction, or how far the best come, to be read aloud."""
    counts = {name: sum(cell.every_seed for cell in _cells(experiment, name)) for name in conditions}
    tried = {name: len(_cells(experiment, name)) for name in conditions}
    how, single = named(experiment), _with_one_seed(experiment, conditions)
    seeds = "its one seed" if len(single) == len(conditions) else "every seed"
    if len(single) < len(conditions):
        how |= {name: f"{how[name]} (one seed)" for name in single}
    everywhere = [name for name in conditions if counts[name] == tried[name]]
    if everywhere:
        names = "; ".join(how[name] for name in everywhere)
        verb = "follows" if len(everywhere) == 1 else "follow"
        number = f"{len(everywhere)} of {len(conditions)} ways to train"
        return f"{number} {verb} with {seeds} up to {MOST} friction: {names}."
    best = max(counts.values())
    if not best:
        return f"None of {len(conditions)} ways to train follows with {seeds} at any friction up to {MOST}."
    those = [how[name] for name in conditions if counts[name] == best]
    at = f"at {best} of {max(tried.values())} frictions"
    return (
        f"None of {len(conditions)} ways to train follows with {seeds} at every friction up to {MOST}; "
        f"the most do {at}: {'; '.join(those)}."
    )


def _purposes(experiment: Experiment) -> dict[str, str]:
    """Return what each condition is, in words that stand alone: `the same, ...` goes on from the one before."""
    purposes: dict[str, str] = {}
    whole = ""
    for condition in experiment.conditions:
        own = condition.purpose
        if own.startswith("the same, "):
            purposes[condition.name] = f"{whole}, {own.removeprefix('the same, ')}"
        else:
            purposes[condition.name] = whole = own
    return purposes


def _cells(experiment: Experiment, condition: str) -> list[Following]:
    """Return who of a condition's students follows, by rising friction, up to `HIGHEST`."""
    own = [cell for cell in experiment.following if cell.method == f"{condition}/{STUDENT}"]
    return sorted((cell for cell in own if cell.friction_level <= HIGHEST), key=lambda cell: cell.friction_level)


def _where_all_follow(experiment: Experiment, condition: str) -> str:
    """Return at how much friction every student of a condition follows: `from 0 to 30 %`."""
    cells = _cells(experiment, condition)
    return places_text({level_text(cell.friction_law, cell.friction_level): cell.every_seed for cell in cells})
