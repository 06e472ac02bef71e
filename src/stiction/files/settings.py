"""What is there is not written over unasked: a folder of other results, or a file.

`settings.json` says what a folder of results was made with, and from inputs of which content, so that the same command
goes on in it, and a run with others is refused. A file says no such thing: it is refused unless the same would be
written.
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
"""The file in a folder of results."""

UNFINISHED = ".unfinished"
"""The file in its place while a run lasts: where that is killed, the same command may write over what is half there."""

FREE = ("out", "json", "overwrite", "jobs", "cluster", "memory_limit", "report", "advice", "judge_again", "key")
"""Options on which results do not depend; options of a kind may name more of them in a `free` of their own."""

SAID = 3
"""Settings, or files, that a refusal names."""

HOW = "choose another {}, or add --overwrite"
"""What to do about a refusal."""


@contextmanager
def results_folder(
    out: Path, verb: str, options: Any, results: Collection[str], inputs: Inputs | None = None
) -> Iterator[None]:
    """Be the only writer of a folder of results, which has none of other settings, and note the settings at the end.

    verb: what writes, `evaluate`, `study wear`; options: its dataclass. `overwrite`, where it has that, lets results of
    other settings be written over. results: files that will be written there, by their paths in `out`; inputs: what is
    read, of which the content counts. What fails notes nothing; what is interrupted goes on with the same settings.
    Raises `StictionError` where the folder has results of other settings, or as `output_folder`.
    """
    from stiction.files.inputs import digests_of

    with output_folder(out):
        digests = digests_of(inputs or {})
        _check(out, verb, options, results, lambda: digests)
        used = _plain(verb, options) | ({"inputs": digests} if digests else {})
        marker, there = out / UNFINISHED, _present(out, results)
        begun = marker.exists()
        with suppress(UnwrittenError):  # A full disk: whoever writes the results says so.
            write_text(marker, json.dumps({"verb": verb}) + "\n")
        try:
            yield
        # An error of the work itself: without this clause the next one would note its settings.
        except Exception:
            # With half of the results written, the folder stays known as one that this program writes.
            if not begun and _present(out, results) == there:
                marker.unlink(missing_ok=True)
            raise
        except BaseException:
            _write(out, used)
            raise
        _write(out, used)


def check_settings(out: Path, verb: str, options: Any, results: Collection[str], inputs: Inputs | None = None) -> None:
    """Raise `ConfigurationError` where a folder has results that `results_folder` would refuse to write over.

    The folder has settings of before, and others, or other inputs; or it has one of the files `results` and no
    settings: then nobody knows of what it is, and it is somebody else's.
    """
    from stiction.files.inputs import digests_of

    _check(out, verb, options, results, lambda: digests_of(inputs or {}))


def _check(
    out: Path, verb: str, options: Any, results: Collection[str], digests: Callable[[], dict[str, dict[str, str]]]
) -> None:
    """Check as above; `digests` are asked for where there is something to compare them with."""
    if getattr(options, "overwrite", False):
        return
    if (out / SETTINGS).exists():
        _refuse_other(out, _plain(verb, options), digests())
    elif (there := _present(out, results)) and not _began(out, verb):
        raise ConfigurationError(
            f"{out} has {' and '.join(there[:SAID])}, and no {SETTINGS} that says what of; {HOW.format('--out')}"
        )


def _present(out: Path, results: Collection[str]) -> list[str]:
    return [name for name in results if (out / name).exists()]


def _began(out: Path, verb: str) -> bool:
    """Say whether a folder without settings is of this verb: of a run that was killed, or of before there were any."""
    for name, said, own in ((UNFINISHED, "verb", verb), ("summary.json", "command", f"stiction {verb}")):
        try:
            found = read_object(out / name, "what `stiction` writes there").get(said)
        except StictionError:
            continue
        if isinstance(found, str) and f"{found} ".startswith(f"{own} "):
            return True
    return False


def check_file(path: Path, options: Any, option: str = "--out", text: str | None = None) -> None:
    """Raise `ConfigurationError` where a file is there that would be lost, and `options.overwrite` does not say so.

    option: the one that names the file; text: what will be written, where that is known. An empty file, one with the
    same text, and what is no file, such as /dev/stdout, may be written to.
    """
    if not options.overwrite and _is_other(path, text):
        raise ConfigurationError(f"{path} exists already; {HOW.format(option)}")


def _is_other(path: Path, text: str | None) -> bool:
    """Say whether there is a file that is not empty and has not the text, byte by byte."""
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

    there = read_object(out / SETTINGS, "what `stiction` writes there; remove it, or choose another --out")
    verb, before = there.get("verb"), there.get("settings")
    how = HOW.format("--out")
    if verb != used["verb"] or not isinstance(before, dict):
        raise ConfigurationError(f"{out} has results of `stiction {verb}`; {how}")
    # Where the content is known, it counts, and not where it lies.
    changed = changes(there.get("inputs"), digests)
    now = {name: value for name, value in used["settings"].items() if name not in changed}
    differing = sorted([*_differing(before, now), *(f"{name} {words}" for name, words in changed.items() if words)])
    if differing:
        more = f" and {len(differing) - SAID} more" if len(differing) > SAID else ""
        raise ConfigurationError(
            f"{out} has results of `stiction {verb}` with other settings: {', '.join(differing[:SAID])}{more}; {how}"
        )


def _differing(before: dict[str, Any], now: dict[str, Any], prefix: str = "") -> list[str]:
    """Return what differs of the settings that both have, in words; another version may have more or fewer."""
    found: list[str] = []
    for name in before.keys() & now.keys():
        old, new = before[name], now[name]
        if isinstance(old, dict) and isinstance(new, dict):
            found += _differing(old, new, f"{prefix}{name}.")
        elif _values(old) != _values(new):
            found.append(f"{prefix}{name}".replace("_", "-") + f" {_words(old)}, now {_words(new)}")
    return sorted(found)


def _values(value: Any) -> list[Any]:
    """Return the values that a person typed: an option that takes several may have taken one in another version."""
    if value is None:
        return []
    return value if isinstance(value, list) else [value]


def _words(value: Any) -> str:
    return "not given" if value is None else " ".join(map(str, _values(value)))[:60] or "none"


def _write(out: Path, used: dict[str, Any]) -> None:
    write_text(out / SETTINGS, json.dumps(used, indent=2) + "\n")
    (out / UNFINISHED).unlink(missing_ok=True)
