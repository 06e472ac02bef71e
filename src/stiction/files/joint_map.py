"""Map of foreign joint names: from the records of a `joints.json` to the joints of a model or robot."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.files.joints import JointsFile

MOST_NAMES = 12
"""Maximum number of joints in an error message."""


def parse_joint_map(pairs: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """Split RECORDED=MODEL pairs; raise `StictionError` for anything else."""
    parsed = []
    for pair in pairs:
        recorded, equals, model = pair.partition("=")
        if not (recorded and equals and model):
            raise ConfigurationError(f"--joint-map {pair!r}: expected RECORDED=MODEL, such as shank=FL_calf_joint")
        parsed.append((recorded, model))
    return tuple(parsed)


def refuse_alone(pairs: Sequence[str], file: object) -> None:
    """Raise `ConfigurationError` for pairs without a `joints.json` whose records they name; None: no pairs."""
    if pairs and file is None:
        raise ConfigurationError("--joint-map names records of a joints.json; name that too, with --joints")


def map_joints(
    file: JointsFile,
    pairs: Sequence[tuple[str, str]],
    model: Sequence[str] | None = None,
    takes: Callable[[str, str], bool] = lambda record, joint: True,
) -> dict[str, str]:
    """Return joint of the model -> record.

    A pair goes first; its right side may have wildcards (`*_calf_joint`) if a model is given. Remaining records are
    matched by name or kind, as in training: `FL_shank` takes the record `FL_shank`, else `shank`. Without a model,
    records keep their names. takes: whether a record is for a joint that is not named in full. Raises `StictionError`
    for a pair that matches nothing, a joint claimed by two records, and a record without a joint.
    """
    record_of: dict[str, str] = {}
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
            if record_of.setdefault(name, recorded) != recorded:
                raise ConfigurationError(
                    f"joint {name!r} is mapped to the records {record_of[name]!r} and {recorded!r}; choose one"
                )
    mapped = set(record_of.values())
    if model is None:
        return record_of | {name: name for name in file.joints if name not in mapped and name not in record_of}
    for name in model:
        key = file.key(name)
        sent = {recorded for recorded, _ in pairs}
        if name not in record_of and key is not None and key not in sent and takes(key, name):
            record_of[name] = key
    lost = [name for name in file.joints if name not in set(record_of.values())]
    if lost:
        more = f" and {len(model) - MOST_NAMES} more" if len(model) > MOST_NAMES else ""
        raise ConfigurationError(
            f"no joint of the model takes the record {lost[0]!r}; name one, as in --joint-map {lost[0]}=JOINT; the "
            f"model has {(', '.join(model[:MOST_NAMES]) + more) or 'none with a name'}"
        )
    return record_of


def mapped(file: JointsFile, pairs: Sequence[str], joint_names: Sequence[str]) -> JointsFile:
    """Return a `joints.json` whose records have the names of a robot's joints, by RECORDED=JOINT pairs.

    Errors as of `parse_joint_map` and `map_joints`. Without pairs the file is returned unchanged.
    """
    if not pairs:
        return file
    record_of = map_joints(file, parse_joint_map(pairs), joint_names)
    return replace(file, joints={name: file.joints[recorded] for name, recorded in record_of.items()})
