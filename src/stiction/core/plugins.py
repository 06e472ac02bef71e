"""Plug-ins: named by a user as `package.module:NAME`, or entry points of installed distributions.

A file holds the name of an entry point only, never of a module, so it can start only installed code.
"""

from __future__ import annotations

import importlib
from importlib import metadata
from typing import Any

from stiction.core.errors import ConfigurationError

VERBS, STUDIES, METHODS = "stiction.verbs", "stiction.studies", "stiction.methods"
"""Groups of entry points: verbs of the program, studies of `stiction study`, training methods (`files.method`)."""


def installed_names(group: str) -> list[str]:
    """Return the sorted names of the entry points of a group."""
    return sorted({entry.name for entry in metadata.entry_points(group=group)})


def find_installed(group: str, name: str) -> Any | None:
    """Return the object of an entry point; None where no installed distribution has one of this name.

    Raises `ConfigurationError` where two distributions have it, or it cannot be imported.
    """
    entries = list(metadata.entry_points(group=group, name=name))
    if not entries:
        return None
    if len(entries) > 1:
        names = " and ".join(sorted(entry.dist.name if entry.dist else "?" for entry in entries))
        raise ConfigurationError(f"{name!r} of {group}: got one from {names}, expected one; uninstall the other")
    try:
        return entries[0].load()
    except (ImportError, AttributeError) as error:
        raise ConfigurationError(f"{entries[0].value} failed to load: {error}; reinstall its distribution") from error


def find_named(kind: str, name: str) -> Any:
    """Return the object named `package.module:NAME`; `kind`: name of its kind in messages, such as `reward term`.

    Raises `StictionError` where the name has another form, or the module or the object does not exist.
    """
    module, colon, variable = name.partition(":")
    if not colon:
        raise ConfigurationError(f"{kind} {name!r}: expected package.module:NAME")
    try:
        return getattr(importlib.import_module(module), variable)
    except (ImportError, ValueError, TypeError) as error:
        raise ConfigurationError(
            f"{kind} {name!r}: the module {module!r} cannot be imported: {error}; install it, or name its folder in "
            "PYTHONPATH"
        ) from error
    except AttributeError as error:
        raise ConfigurationError(f"{kind} {name!r}: the module {module} has no {variable!r}") from error
