"""Figures that are made and not drawn: laying one out and drawing it is most of the time of a page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import pytest

from stiction.report import page


@contextmanager
def blank_figures() -> Iterator[None]:
    """Let files of figures be blank, for tests that look at no picture; what is plotted and written is all there."""
    from matplotlib.figure import Figure

    def blank(figure: Figure, file: Path | str | IO[bytes], **settings: object) -> None:
        if isinstance(file, (Path, str)):
            Path(file).write_bytes(b"blank")
        else:
            file.write(b"blank")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "finished", lambda figure: figure)
        patch.setattr(Figure, "savefig", blank)
        yield
