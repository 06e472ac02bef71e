"""Other people's names of joints: which record of a `joints.json` is for which joint of a model or robot."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.files.joints import JointsFile

MOST_NAMES = 12
"""Joints of a model that an error lists."""


def parse_joint_map(pairs: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """Split RECORDED=MODEL pairs; raise `StictionError` for anything else."""
    found = []
    for pair in pairs:
        recorded, equals, model = pair.partition("=")
        if not (recorded and equals and model):
            raise ConfigurationError(f"--joint-map {pair!r}: expected RECORDED=MODEL, such as shank=FL_calf_joint")
        found.append((recorded, model))
    return tuple(found)


def refuse_alone(pairs: Sequence[str], file: object) -> None:
    """Raise `ConfigurationError` for pairs where there is no `joints.json` whose records they name; None: none."""
    if pairs and file is None:
        raise ConfigurationError("--joint-map names records of a joints.json; name that too, with --joints")


def map_joints(
    file: JointsFile,
    pairs: Sequence[tuple[str, str]],
    model: Sequence[str] | None = None,
    takes: Callable[[str, str], bool] = lambda record, joint: True,
) -> dict[str, str]:
    """Return joint of the model -> record.

    A pair goes first; its right side may have wildcards (`*_calf_joint`) where a model is given. What no pair names is
    matched by name or kind, as in training: `FL_shank` takes the record `FL_shank`, else `shank`. Without a model,
    records keep their own names. takes: whether a record is for a joint that is not named in full. Raises
    `StictionError` for a pair that matches nothing, a joint claimed by two records, and a record that finds no joint.
    """
    found: dict[str, str] = {}
    for recorded, pattern in pairs:
        if recorded not in file.joints:
            raise ConfigurationError(
                f"--joint-map {recorded}={pattern}: {unknown_name('record', recorded, file.joints)}"
            )
        names = [pattern]
        if model is not None and pattern not in model:
            matching = [name for name in model if fnmatchcase(name, pattern)]
            if not matching:
                raise ConfigurationError(f"--joint-map {recorded}={pattern}: {unknown_name('joint', pattern, model)}")
            if not (names := [name for name in matching if takes(recorded, name)]):
                raise ConfigurationError(
                    f"--joint-map {recorded}={pattern}: matches {', '.join(matching[:MOST_NAMES])}; expected a "
                    f"joint that moves as the record's {file.joints[recorded].axis} axis, and is driven"
                )
        for name in names:
            if found.setdefault(name, recorded) != recorded:
                raise ConfigurationError(
                    f"joint {name!r} is mapped to the records {found[name]!r} and {recorded!r}; choose one"
                )
    mapped = set(found.values())
    if model is None:
        return found | {name: name for name in file.joints if name not in mapped and name not in found}
    for name in model:
        key = file.key(name)
        sent = {recorded for recorded, _ in pairs}
        if name not in found and key is not None and key not in sent and takes(key, name):
            found[name] = key
    lost = [name for name in file.joints if name not in set(found.values())]
    if lost:
        more = f" and {len(model) - MOST_NAMES} more" if len(model) > MOST_NAMES else ""
        raise ConfigurationError(
            f"no joint of the model takes the record {lost[0]!r}; name one, as in --joint-map {lost[0]}=JOINT; the "
            f"model has {(', '.join(model[:MOST_NAMES]) + more) or 'none with a name'}"
        )
    return found


def mapped(file: JointsFile, pairs: Sequence[str], joint_names: Sequence[str]) -> JointsFile:
    """Return a `joints.json` whose records have the names of a robot's joints, by RECORDED=JOINT pairs.

    Errors as of `parse_joint_map` and `map_joints`. Without pairs the file is returned as it is.
    """
    if not pairs:
        return file
    found = map_joints(file, parse_joint_map(pairs), joint_names)
    return replace(file, joints={name: file.joints[recorded] for name, recorded in found.items()})
