"""The flag for virtual robots' seeds, the same in every verb that has it."""

from __future__ import annotations

from typing import Annotated

import tyro

RobotSeeds = Annotated[
    tuple[int, ...],
    tyro.conf.arg(
        help="Seeds of the virtual robots. Those from 1000 on are kept for results; smaller ones are for making and "
        "tuning methods, and results on them are called exploratory."
    ),
]
"""Type of an option `robots`."""
