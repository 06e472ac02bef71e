"""Fixtures that several rooms share."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from blank_figures import blank_figures
from bundles import make_bundle, make_contract
from stiction.files.contract import Contract

# Where the environment forbids bytecode, each of the hundreds of processes would compile the package again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


LONG = (
    *("cli/test_bundle_verbs.py", "cli/test_deploy.py", "cli/test_excite.py", "cli/test_identify.py"),
    *("cli/test_judge_again.py", "cli/test_train.py", "cli/test_train_actuator.py", "cli/test_walking_verb.py"),
    *("experiments/engines/test_study_engines.py"),
    "experiments/wear/test_wear_study.py",
    *("api/test_examples.py", "house/test_code_blocks.py"),
    *(
        "identification/excite/test_excite_plan.py",
        "identification/logs/test_limits.py",
        "identification/logs/test_recipes.py",
    ),
    "report/test_pages_in_browser.py",
    *("identification/test_combinations.py", "identification/test_go2.py", "identification/test_loop_choice.py"),
    *("identification/test_pipeline.py", "identification/test_record.py", "virtual/test_run_bench.py"),
)
"""Files of more than ten seconds in which no single test is slow."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put long files first: of two processes, one would wait for the other's long file at the end."""
    here = Path(__file__).parent
    slow = {item.path for item in items if item.get_closest_marker("slow")} | {here / name for name in LONG}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture
def contract() -> Contract:
    """A valid contract for Saturn Lite."""
    return make_contract()


@pytest.fixture
def bundle(tmp_path: Path, contract: Contract) -> Path:
    """A complete bundle that passes every check."""
    return make_bundle(tmp_path / "toy", contract)


@pytest.fixture
def undrawn() -> Iterator[None]:
    """For tests that look at none of the figures that are made on the way: see `blank_figures`."""
    with blank_figures():
        yield


@pytest.fixture(autouse=True)
def search_path_of_children() -> Iterator[None]:
    """A test that isolates the processes it starts leaves those of the next test as they were."""
    before = os.environ.get("PYTHONSAFEPATH")
    yield
    if before is None:
        os.environ.pop("PYTHONSAFEPATH", None)
