"""Results at a glance, for terminal and page alike: the facts, the answer in a word, what to do next, and where why is.

The terminal shows them in six lines or fewer, the page as a card above all else. What they rest on, and what is not
known, is folded away on the page, and in the machine-readable files.
"""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from rich.console import Console, RenderableType
from rich.text import Text

if TYPE_CHECKING:
    from markupsafe import Markup

    from stiction.files.joints import Estimate

Tone = Literal["good", "note", "warn", "bad", "unknown"]
"""Colour of an answer, from the best to the worst; `unknown` where there is none."""

STYLES: dict[str, str] = {
    "good": "bold green",
    "note": "bold yellow",
    "warn": "bold dark_orange",
    "bad": "bold red",
    "unknown": "bold magenta",
}
"""Tone -> style of the terminal."""

COMMAND = "stiction "
"""Begin of our commands."""

SHELL = (COMMAND, "pip install ", "uv pip install ")
"""Begins of a next step that can be copied into a shell."""


MOST_ERRORS = 3
"""Errors that the terminal shows above a table; without one it shows the first, so that all fits into six lines."""


MOST_NOTES = 2
"""Reservations that the terminal shows."""


@dataclass(frozen=True)
class Glance:
    """A result at a glance."""

    facts: str
    """Numbers, in one line."""
    question: str
    """Word before the answer: `Matters`."""
    answer: str
    """Answer: in capitals but for what follows ` without `, ` at `, ` up to `, a comma or a bracket."""
    tone: Tone
    step: str = ""
    """Next step: a command, which begins with one of `SHELL`, or an instruction."""
    errors: tuple[str, ...] = ()
    """Errors that change the meaning of the answer, a sentence each; shortened to a line at the terminal."""
    notes: tuple[str, ...] = ()
    """Reservations that change it, likewise."""
    why: str = ""
    """Place of all that is not shown: `why, and what is not known: report.html`."""

    @property
    def is_command(self) -> bool:
        """True if the next step can be copied into a shell."""
        return self.step.startswith(SHELL)

    @property
    def lines(self) -> tuple[str, ...]:
        """The result as plain text, a line each: facts, answer, errors, reservations, next step."""
        return (
            self.facts,
            f"{self.question}: {''.join(self.words)}",
            *(f"error: {text}" for text in self.errors),
            *(f"note: {text}" for text in self.notes),
            *([f"Next: {self.step}"] if self.step else []),
        )

    @property
    def words(self) -> tuple[str, str]:
        """The answer in capitals, and what is said after it."""
        ends = [place for mark in (" without ", " at ", " up to ", ", ", " (") if (place := self.answer.find(mark)) > 0]
        end = min(ends, default=len(self.answer))
        return self.answer[:end].upper(), self.answer[end:]


def print_glance(console: Console, glance: Glance, *tables: RenderableType) -> None:
    """Print a result in lines of the terminal's width, a table before its last line; in whole lines into a file."""
    whole = not console.is_terminal

    def line(text: str | Text, soft: bool = whole, style: str = "") -> None:
        console.print(text, soft_wrap=soft, highlight=False, style=style)

    def short(text: str) -> str:
        return text if whole else textwrap.shorten(text, console.width, placeholder=" …")

    answer, rest = glance.words
    line(glance.facts)
    line(Text.assemble(f"{glance.question}: ", (answer, STYLES[glance.tone]), rest))
    count = len(glance.errors)
    shown = count if whole else min(count, MOST_ERRORS if tables else 1)
    for number, text in enumerate(glance.errors[:shown], 1):
        which = f" {number} of {count}" if shown < count else ""
        line(short(f"error{which}: {text}"), style="red")
    for text in glance.notes if whole else glance.notes[:MOST_NOTES]:
        line(short(f"note: {text}"), style="yellow")
    if glance.is_command:
        line("Next:")
        # A command is one line of the shell, however long: the terminal wraps it, and copies it whole.
        line(f"  {glance.step}", soft=True, style="bold")
    elif glance.step:
        line(f"Next: {glance.step}")
    for table in tables:
        console.print(table)
    if glance.why:
        line(glance.why, soft=True, style="dim")


def two_digits(value: float) -> str:
    """Return a number with two significant digits, a trailing zero included: `1.0`, `0.098`, `120`."""
    return _placed(value, value)


def plus_minus(estimate: Estimate, factor: float = 1.0) -> str:
    """Return `value ± half-width` of the 95 % interval: two digits of the half-width, and the value to the same place.

    Where there may be nothing, the most that it may be: `at most 0.12`.
    """
    low, high = (factor * end for end in estimate.interval95)
    if low <= 0:
        return f"at most {two_digits(max(high, 0.0))}"
    half = (high - low) / 2
    return f"{_placed(factor * estimate.value, half)} ± {two_digits(half)}" if half else two_digits(low)


def _placed(value: float, like: float) -> str:
    """Return a number to the place of the second significant digit of another one."""
    if not like or not math.isfinite(like):
        return f"{value:.2g}"
    # Rounded first: 0.0996 is 0.10, which has a place less.
    place = 1 - int(f"{abs(like):.1e}".partition("e")[2])
    return f"{value:.{place}f}" if place > 0 else f"{round(value, place):.0f}"


def card(glance: Glance, *figures: Markup) -> Markup:
    """Return the result as the card that a page begins with. figures: from the most important on, the last beside."""
    from stiction.report.page import render_block

    return render_block("card", glance, *glance.words, figures)
