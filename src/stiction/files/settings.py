"""Refuse to overwrite existing results without --overwrite.

`settings.json` records the settings of a folder of results, and the digests of its inputs, so that the same command
continues in it, and a run with others is refused. A single file has no such record: it is refused unless the same
content would be written.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction.core.errors import ConfigurationError, StictionError, UnwrittenError
from stiction.core.files import write_text
from stiction.core.lock import output_folder
from stiction.files.plain import read_object

if TYPE_CHECKING:
    from stiction.files.inputs import Inputs

SETTINGS = "settings.json"
"""File of settings in a folder of results."""

UNFINISHED = ".unfinished"
"""File in its place during a run; after a kill, the same command may overwrite the partial results."""

FREE = ("out", "json", "overwrite", "jobs", "cluster", "memory_limit", "report", "advice", "judge_again", "key")
"""Options without an effect on results; a dataclass of options may name more of them in `free`."""

SAID = 3
"""Maximum number of settings, or files, in a refusal."""

HOW = "choose another {}, or add --overwrite"
"""Remedies of a refusal."""


@contextmanager
def results_folder(
    out: Path, verb: str, options: Any, results: Collection[str], inputs: Inputs | None = None
) -> Iterator[None]:
    """Lock a folder of results, which has none of other settings, and record the settings at the end.

    verb: its name, `evaluate`, `study wear`; options: its dataclass. `overwrite`, where it has that, allows overwriting
    results of other settings. results: files that will be written, by their paths in `out`; inputs: files read, whose
    content counts. A failure records nothing; an interrupted run continues with the same settings. Raises
    `StictionError` where the folder has results of other settings, or as `output_folder`.
    """
    from stiction.files.inputs import digests_of

    with output_folder(out):
        digests = digests_of(inputs or {})
        _check(out, verb, options, results, lambda: digests)
        used = _plain(verb, options) | ({"inputs": digests} if digests else {})
        marker, present = out / UNFINISHED, _present(out, results)
        begun = marker.exists()
        with suppress(UnwrittenError):  # A full disk: whoever writes the results says so.
            write_text(marker, json.dumps({"verb": verb}) + "\n")
        try:
            yield
        # An error of the work itself: without this clause the next one would note its settings.
        except Exception:
            # With half of the results written, the folder stays known as one that this program writes.
            if not begun and _present(out, results) == present:
                marker.unlink(missing_ok=True)
            raise
        except BaseException:
            _write(out, used)
            raise
        _write(out, used)


def check_settings(out: Path, verb: str, options: Any, results: Collection[str], inputs: Inputs | None = None) -> None:
    """Raise `ConfigurationError` where a folder has results that `results_folder` would not overwrite.

    The folder has other settings or other inputs; or it has one of the files `results` and no settings, so that their
    origin is unknown.
    """
    from stiction.files.inputs import digests_of

    _check(out, verb, options, results, lambda: digests_of(inputs or {}))


def _check(
    out: Path, verb: str, options: Any, results: Collection[str], digests: Callable[[], dict[str, dict[str, str]]]
) -> None:
    """Check as above; `digests` is called only if there are some to compare with."""
    if getattr(options, "overwrite", False):
        return
    if (out / SETTINGS).exists():
        _refuse_other(out, _plain(verb, options), digests())
    elif (present := _present(out, results)) and not _belongs_to(out, verb):
        raise ConfigurationError(f"{out} has {', '.join(present[:SAID])} and no {SETTINGS}; {HOW.format('--out')}")


def _present(out: Path, results: Collection[str]) -> list[str]:
    return [name for name in results if (out / name).exists()]


def _belongs_to(out: Path, verb: str) -> bool:
    """Return whether a folder without settings belongs to this verb: from a killed run, or an older version."""
    for name, key, expected in ((UNFINISHED, "verb", verb), ("summary.json", "command", f"stiction {verb}")):
        try:
            recorded = read_object(out / name, "what `stiction` writes there").get(key)
        except StictionError:
            continue
        if isinstance(recorded, str) and f"{recorded} ".startswith(f"{expected} "):
            return True
    return False


def check_file(path: Path, options: Any, option: str = "--out", text: str | None = None) -> None:
    """Raise `ConfigurationError` where a file would be lost, unless `options.overwrite`.

    option: the option that names the file; text: its new content, if known. An empty file, one with the same text, and
    a device, such as /dev/stdout, may be overwritten.
    """
    if not options.overwrite and _is_other(path, text):
        raise ConfigurationError(f"{path} exists already; {HOW.format(option)}")


def _is_other(path: Path, text: str | None) -> bool:
    """Return whether a file exists that is not empty and differs from the text."""
    try:
        if not path.is_file() or not (size := path.stat().st_size):
            return False
    except OSError:
        return False  # Where a folder above may not be looked into, the writing says so.
    content = None if text is None else text.encode()
    try:
        return content is None or len(content) != size or path.read_bytes() != content
    except OSError:
        return True


def _plain(verb: str, options: Any) -> dict[str, Any]:
    free = (*FREE, *getattr(options, "free", ()))
    settings = {name: value for name, value in asdict(options).items() if name not in free}
    # As it will be read back, to be compared with it: tuples are lists, paths are text.
    return json.loads(json.dumps({"verb": verb, "settings": settings}, default=str))


def _refuse_other(out: Path, used: dict[str, Any], digests: dict[str, dict[str, str]]) -> None:
    """Raise `ConfigurationError` where a folder has results of another verb, or of other settings or inputs."""
    from stiction.files.inputs import changes

    recorded = read_object(out / SETTINGS, "what `stiction` writes there; remove it, or choose another --out")
    verb, before = recorded.get("verb"), recorded.get("settings")
    how = HOW.format("--out")
    if verb != used["verb"] or not isinstance(before, dict):
        raise ConfigurationError(f"{out} has results of `stiction {verb}`; {how}")
    # Where the content is known, it counts, and not where it lies.
    changed = changes(recorded.get("inputs"), digests)
    now = {name: value for name, value in used["settings"].items() if name not in changed}
    differing = sorted([*_differing(before, now), *(f"{name} {words}" for name, words in changed.items() if words)])
    if differing:
        more = f" and {len(differing) - SAID} more" if len(differing) > SAID else ""
        raise ConfigurationError(
            f"{out} has results of `stiction {verb}` with other settings: {', '.join(differing[:SAID])}{more}; {how}"
        )


def _differing(before: dict[str, Any], now: dict[str, Any], prefix: str = "") -> list[str]:
    """Return the differences of the settings in both, in words; another version may have more or fewer."""
    differences: list[str] = []
    for name in before.keys() & now.keys():
        old, new = before[name], now[name]
        if isinstance(old, dict) and isinstance(new, dict):
            differences += _differing(old, new, f"{prefix}{name}.")
        elif _values(old) != _values(new):
            differences.append(f"{prefix}{name}".replace("_", "-") + f" {_words(old)}, now {_words(new)}")
    return sorted(differences)


def _values(value: Any) -> list[Any]:
    """Return the typed values: an option with several values may have had one in another version."""
    if value is None:
        return []
    return value if isinstance(value, list) else [value]


def _words(value: Any) -> str:
    return "not given" if value is None else " ".join(map(str, _values(value)))[:60] or "none"


def _write(out: Path, used: dict[str, Any]) -> None:
    write_text(out / SETTINGS, json.dumps(used, indent=2) + "\n")
    (out / UNFINISHED).unlink(missing_ok=True)
