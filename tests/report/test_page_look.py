"""Shared page layout: contents, origin, grouped tables, and lines distinguishable to colour-blind readers."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from stiction.report.page import (
    COLORS,
    MARKS,
    Section,
    anchors,
    label_ends,
    line_look,
    mark_look,
    new_figure,
    paragraph,
    render_page,
    spaced,
)

EYES = {
    "normal": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]],
}
"""Kind of eyes -> linear RGB as they see it, for a deficiency that is complete (Machado, Oliveira, Fernandes 2009)."""

APART = 20.0
"""Distance in CIELAB of two colours that are told apart at a glance; 2.3 can just be noticed."""


def linear(color: str) -> np.ndarray:
    """Return linear RGB of `#rrggbb` in sRGB."""
    value = np.array([int(color[at : at + 2], 16) for at in (1, 3, 5)]) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    """Return CIELAB of linear RGB, white D65."""
    matrix = [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.072175], [0.0193339, 0.119192, 0.9503041]]
    xyz = np.array(matrix) @ rgb / np.array([0.95047, 1.0, 1.08883])
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("eyes", EYES)
def test_colours_are_apart_to_every_kind_of_eyes(eyes: str) -> None:
    """Colours stay distinguishable under every kind of colour vision."""
    seen = [lab(np.clip(np.array(EYES[eyes]) @ linear(color), 0, 1)) for color in COLORS]
    assert min(float(np.linalg.norm(one - other)) for one, other in combinations(seen, 2)) > APART


def test_lines_differ_in_more_than_colour() -> None:
    """Lines differ in dash pattern and marker as well as colour."""
    names = [str(number) for number in range(12)]
    looks = [line_look(name, names) for name in names]
    assert len({str(look["linestyle"]) for look in looks[:6]}) == 6
    assert len({(look["color"], str(look["linestyle"])) for look in looks}) == 12
    assert [mark_look(name, names) for name in names[:6]] == list(MARKS)


def test_names_stand_at_the_ends_of_their_lines_and_not_on_each_other() -> None:
    """Labels stand at the ends of their lines, without overlap."""
    _, (axis,) = new_figure()
    for name, end in (("low", 0.0), ("high", 1.0), ("as high", 1.0)):
        axis.plot([0, 1], [0.5, end], label=name)
    axis.plot([0, 1], [0, 0], label="_mark")
    label_ends(axis)
    assert sorted(text.get_text() for text in axis.texts) == ["as high", "high", "low"]
    heights = sorted(text.get_position()[1] for text in axis.texts)
    assert min(np.diff(heights)) > 0.05
    assert spaced([0.0, 0.01, 0.5], 0.1) == [0.0, 0.1, 0.5]
    assert spaced([0.95, 1.0], 0.1) == pytest.approx([0.9, 1.0])


def test_a_page_begins_with_what_made_it_and_a_list_of_its_parts() -> None:
    """A page of several sections starts with its command and a list of its sections."""
    parts = [Section(title, (paragraph("x"),)) for title in ("The answer", "Every row", "Every row")]
    page = render_page("t", parts, "It holds.", command="stiction evaluate X", date="2026-11-23")
    assert "Drawn on 2026-11-23; what it shows was made by <code>stiction evaluate X</code>." in page
    for name in ("the-answer", "every-row", "every-row-2"):
        assert f'<a href="#{name}">' in page and f'<section id="{name}">' in page
    assert "<nav" not in render_page("t", parts[:1])
    assert anchors(["µ?", "µ!"]) == ["part", "part-2"]
