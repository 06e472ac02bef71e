"""Figures that are made and not drawn: laying one out and drawing it is most of the time of a page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO

import pytest

from stiction.report import page


@contextmanager
def blank_figures() -> Iterator[None]:
    """Let files of figures be blank, for tests that look at no picture; what is plotted and written is all there."""
    from matplotlib.figure import Figure

    def blank(figure: Figure, file: IO[bytes], **settings: object) -> None:
        file.write(b"blank")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "finished", lambda figure: figure)
        patch.setattr(page, "paletted", lambda png: png)
        patch.setattr(Figure, "savefig", blank)
        yield
