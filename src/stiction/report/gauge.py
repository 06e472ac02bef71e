"""Gauge of the verdict: a joint's friction over the zones of the four answers, and speed over friction as it walked."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from markupsafe import Markup

from stiction.files.onset import LEAST, NOTICED, shipped_onsets
from stiction.identification.scale import SYMBOLS, Scale
from stiction.report.glance import Tone
from stiction.report.page import render_block

LEFT, RIGHT = 12.0, 508.0
"""Ends of the axis of gauge and figure, in a drawing that is 520 wide [px]."""


@dataclass(frozen=True)
class Zone:
    """One answer's part of the gauge."""

    answer: str
    tone: Tone
    begin: float
    end: float

    @property
    def shown(self) -> bool:
        """True if there is room for its name."""
        return self.end - self.begin > 7 * len(self.answer)


ANSWERS: dict[str, Tone] = {"no": "good", "a little": "note", "probably": "warn", "yes": "bad"}
"""Answer to whether friction matters -> its tone."""


def gauge(scale: Scale, value: float) -> Markup:
    """Draw the friction and its interval over the zones of the four answers."""
    across, ticks, unit = _axis(scale)
    ends = [0.0, *scale.ends, _most(scale)]
    zones = [
        Zone(answer, tone, across(ends[index]), across(ends[index + 1]))
        for index, (answer, tone) in enumerate(ANSWERS.items())
    ]
    low, high, most = (across(max(0.0, each)) for each in (scale.low, scale.high, scale.most))
    symbol = SYMBOLS[scale.axis][0]
    beyond = "" if scale.margin == 1.0 else f"; dashed: up to {scale.margin:g} times that, which load may add"
    text = f"{symbol}{unit}: the estimate and its 95 % interval{beyond}"
    return render_block("gauge", zones, (across(value), low, high, most), ticks, text)


def speeds(scale: Scale, value: float) -> Markup:
    """Draw what policies trained without friction kept of their speed, of every robot that walked, and this joint."""
    across, ticks, unit = _axis(scale)
    evidence = shipped_onsets()

    def down(share: float) -> float:
        return 18.0 + (1.0 - share) / (1.0 - LEAST) * 150.0

    lines = []
    for condition in evidence.conditions:
        reached = ((0.0, 1.0), (condition.on(scale.axis, "noticed"), NOTICED), (condition.on(scale.axis), LEAST))
        lines.append([(across(friction), down(share)) for friction, share in reached])
    low, most = (across(max(0.0, each)) for each in (scale.low, scale.most))
    levels = [(down(share), f"{100 * share:.0f} %") for share in (1.0, NOTICED, LEAST)]
    text = (
        f"Speed that policies trained without friction keep under the worst command, over {SYMBOLS[scale.axis][0]}"
        f"{unit}: {len(lines)} robots and gains, in simulation; measured at the dots. The band is this joint."
    )
    return render_block("speeds", lines, (across(value), low, most), ticks, levels, text)


def _most(scale: Scale) -> float:
    """Return the right end of the axis: beyond all onsets, and beyond the joint."""
    return 1.1 * max(scale.most, *shipped_onsets().middles(scale.axis))


def _axis(scale: Scale) -> tuple[Callable[[float], float], list[tuple[float, str]], str]:
    """Return the map from friction to pixels, ticks as (pixel, text), and the unit."""
    _, factor, unit = SYMBOLS[scale.axis]
    if scale.axis != "torque_limit":
        # People see degrees, and radians fill a line with zeros.
        factor, unit = math.degrees(1.0), "°"
    most = _most(scale)
    step = next(step for step in _STEPS if factor * most / step <= 6)

    def across(friction: float) -> float:
        return LEFT + (RIGHT - LEFT) * min(friction / most, 1.0)

    ticks = [(across(number * step / factor), f"{number * step:g}") for number in range(int(factor * most / step) + 1)]
    return across, ticks, f" [{unit.strip()}]"


_STEPS = [digit * 10.0**power for power in range(-6, 6) for digit in (1, 2, 5)]
"""Distances between ticks."""
