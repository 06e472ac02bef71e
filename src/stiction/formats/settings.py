"""What is there is not written over unasked: a folder of other results, or a file.

`settings.json` says what a folder of results was made with, so that the same command goes on in it, and a run with
other settings is refused. A file says no such thing: it is refused unless the same would be written.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stiction.core.errors import ConfigurationError
from stiction.core.files import write_text
from stiction.core.lock import output_folder
from stiction.formats.plain import read_object

SETTINGS = "settings.json"
"""The file in a folder of results."""

FREE = ("out", "json", "overwrite", "jobs", "cluster", "memory_limit", "report", "advice", "judge_again")
"""Options on which results do not depend; options of a kind may name more of them in a `free` of their own."""

SAID = 3
"""Settings, or files, that a refusal names."""

HOW = "choose another {}, or add --overwrite"
"""What to do about a refusal."""


@contextmanager
def results_folder(out: Path, verb: str, options: Any, results: Collection[str] = ()) -> Iterator[None]:
    """Be the only writer of a folder of results, which has none of other settings, and note the settings at the end.

    verb: what writes, `evaluate`, `study wear`; options: its dataclass. `overwrite`, where it has that, lets results of
    other settings be written over. results: as in `check_settings`. What fails notes nothing; what is interrupted goes
    on with the same settings.

    Raises `StictionError` where the folder has results of other settings, or as `output_folder`.
    """
    with output_folder(out):
        check_settings(out, verb, options, results)
        used = _plain(verb, options)
        try:
            yield
        # An error of the work itself: without this clause the next one would note its settings.
        except Exception:
            raise
        except BaseException:
            _write(out, used)
            raise
        _write(out, used)


def check_settings(out: Path, verb: str, options: Any, results: Collection[str] = ()) -> None:
    """Raise `ConfigurationError` where a folder has results of other settings, which may not be written over.

    results: files that will be written there; where the folder has one of them and no settings, nobody knows of what
    it is, and it is somebody else's.
    """
    if getattr(options, "overwrite", False):
        return
    if (out / SETTINGS).exists():
        _refuse_other(out, _plain(verb, options))
    elif there := [name for name in results if (out / name).exists()]:
        raise ConfigurationError(
            f"{out} has {' and '.join(there[:SAID])}, and no {SETTINGS} that says what of; {HOW.format('--out')}"
        )


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
    """Return verb and options as JSON has them."""
    free = (*FREE, *getattr(options, "free", ()))
    settings = {name: value for name, value in asdict(options).items() if name not in free}
    # As it will be read back, to be compared with it: tuples are lists, paths are text.
    return json.loads(json.dumps({"verb": verb, "settings": settings}, default=str))


def _refuse_other(out: Path, used: dict[str, Any]) -> None:
    """Raise `ConfigurationError` where a folder has results of another verb, or of other settings."""
    there = read_object(out / SETTINGS, "what `stiction` writes there; remove it, or choose another --out")
    verb, before = there.get("verb"), there.get("settings")
    how = HOW.format("--out")
    if verb != used["verb"] or not isinstance(before, dict):
        raise ConfigurationError(f"{out} has results of `stiction {verb}`; {how}")
    differing = _differing(before, used["settings"])
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
        elif old != new:
            found.append(f"{prefix}{name}".replace("_", "-") + f" {_words(old)}, now {_words(new)}")
    return sorted(found)


def _words(value: Any) -> str:
    """Return a value as a person types it."""
    text = " ".join(map(str, value)) if isinstance(value, list) else str("not given" if value is None else value)
    return text[:60] or "none"


def _write(out: Path, used: dict[str, Any]) -> None:
    """Note the settings in the folder."""
    write_text(out / SETTINGS, json.dumps(used, indent=2) + "\n")
