"""The size of a clone: text, one figure a page, networks without golden vectors."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from stiction.core.records import read_rows

CHECKOUT = Path(__file__).parents[2]

TREE = 38_000_000
"""Largest size of all files together [B]."""

FILE = 700_000
"""Largest size of a file outside the shipped policies [B]."""

LARGER = {"results/adaptation/summary.json"}
"""Files that are larger, until they are made anew or go."""

IMAGES = 2_000_000
"""Largest size of all images and films together [B]."""

SUFFIXES = (".png", ".jpg", ".jpeg", ".gif", ".webp", ".webm", ".mp4", ".svg")
"""Ends of their names."""

SHIPPED = "src/stiction/policies/"


@pytest.fixture(scope="module", name="sizes")
def sizes_of_files() -> dict[str, int]:
    """Return the size [B] of every file that git knows or would add."""
    words = ["git", "-C", str(CHECKOUT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        listed = subprocess.run(words, capture_output=True, check=True).stdout.decode().rstrip("\0").split("\0")
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no git checkout: which files are committed is not known")
    return {name: (CHECKOUT / name).stat().st_size for name in set(listed) if (CHECKOUT / name).is_file()}


def test_the_tree_and_its_files_are_small(sizes: dict[str, int]) -> None:
    """Holds the size of a clone; a file that grew is committed smaller, or as the command that makes it."""
    assert sum(sizes.values()) <= TREE
    large = {name for name, size in sizes.items() if size > FILE and not name.startswith(SHIPPED)}
    assert large == LARGER


def test_images_and_films_together_are_small(sizes: dict[str, int]) -> None:
    """Holds what a reader of the documents downloads: `save_figure` writes 64 colours, `tools/hero.py` the film."""
    images = {name: size for name, size in sizes.items() if name.endswith(SUFFIXES)}
    assert "docs/hero.webp" in images and "docs/viewer.webp" in images
    assert sum(images.values()) <= IMAGES, sorted(images.items(), key=lambda one: -one[1])[:5]


def test_results_are_text_figures_and_networks(sizes: dict[str, int]) -> None:
    """Holds pages, which are drawn from rows, and golden vectors, which `policy_records.py` drops, out of results."""
    results = [name for name in sizes if name.startswith("results/")]
    assert results and not [name for name in results if name.endswith((".html", ".npz"))]


def test_every_network_of_the_results_is_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Holds names, commands and hashes of the table to the folders; a policy that was removed keeps its row."""
    monkeypatch.syspath_prepend(str(CHECKOUT / "tools"))
    import policy_records

    listed = read_rows(policy_records.RESULTS / "policies.csv", policy_records.PolicyRow)
    assert listed == policy_records.policy_rows(policy_records.RESULTS)
    assert len(listed) >= 206 and {row.kept for row in listed} == {True, False}


def test_the_install_part_names_the_shallow_clone() -> None:
    """Spares a reader of the front page the history."""
    install = (CHECKOUT / "README.md").read_text().split("## Install\n")[1].split("\n## ")[0]
    assert "`git clone --depth 1`" in install
