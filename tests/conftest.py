"""Fixtures that several rooms share."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bundles import make_bundle, make_contract
from stiction.core.gemm import open_fast_gemm
from stiction.formats.contract import Contract

# Where the environment forbids bytecode, each of the hundreds of processes would compile the package again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# Before a test loads torch, as the program does: what is trained here has the bits of what it trains.
open_fast_gemm()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put files with slow tests first: of two processes, one would wait for the other's long file at the end."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture
def contract() -> Contract:
    """A valid contract for Saturn Lite."""
    return make_contract()


@pytest.fixture
def bundle(tmp_path: Path, contract: Contract) -> Path:
    """A complete bundle that passes every check."""
    return make_bundle(tmp_path / "toy", contract)


@pytest.fixture(autouse=True)
def search_path_of_children() -> Iterator[None]:
    """A test that isolates the processes it starts leaves those of the next test as they were."""
    before = os.environ.get("PYTHONSAFEPATH")
    yield
    if before is None:
        os.environ.pop("PYTHONSAFEPATH", None)
