"""What belongs to a user: found by its name as `package.module:NAME`, anywhere on the Python path."""

from __future__ import annotations

import importlib
from typing import Any

from stiction.core.errors import ConfigurationError


def find_named(kind: str, name: str) -> Any:
    """Return what `package.module:NAME` names; `kind`: what it should be, such as `reward term`, for messages.

    Raises `StictionError` where the name has no such form, or there is no such module or nothing of that name in it.
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
        raise ConfigurationError(f"{kind} {name!r}: there is no {variable!r} in {module}") from error
