"""Take away the entry points of training methods, as where no distribution has any."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from stiction.core import plugins
from stiction.files.method import known_method
from stiction.learning.identity import defaults


@contextmanager
def without_methods() -> Iterator[None]:
    """Find no entry point of `stiction.methods` for a while."""
    entries = plugins.metadata.entry_points

    def entry_points(**selected: str) -> Any:
        return () if selected.get("group") == plugins.METHODS else entries(**selected)

    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(plugins.metadata, "entry_points", entry_points)
            for cached in (known_method, defaults):
                cached.cache_clear()
            yield
    finally:
        for cached in (known_method, defaults):
            cached.cache_clear()
