"""Code path of a row of an evaluation: plan, walk, row, and no other modules."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from stiction.engines.catalog import missing_engine
from stiction.robots.catalog import find_robot

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

MOST = {"mujoco": (30, 8), "mujoco-alone": (36, 8), "physx+all": (34, 8)}
"""Engine -> most modules in which a function is called between a plan and its rows, and most rooms. `robots.physics`
is one of them since a row of friction has one source there, where three modules wrote its numbers."""

MOST_IMPORTED = 72
"""Most modules that are imported by then."""

PROGRAM = """
import json, sys
from pathlib import Path
import stiction
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import GridCfg, plan, units
from stiction.evaluation.table import rows_of
from stiction.evaluation.grid import walk_unit
from stiction.files.bundle import find_bundle, read_bundle

house, visited = str(Path(stiction.__file__).parent), set()

def look(frame, event, argument):
    code = frame.f_code
    if event == "call" and code.co_name != "<module>" and code.co_filename.startswith(house):
        visited.add(Path(code.co_filename).relative_to(house).as_posix())

bundle = read_bundle(find_bundle(Path("saturn_lite-flat-none-0.2")))
grid = GridCfg(EvaluationCfg((0.2,), ("vx=0.5",), 1, 3.0), engines=(sys.argv[1],), robots=(1000,))
sys.setprofile(look)
walked = {}
for unit in units(plan([bundle.name], grid), grid):
    walked |= dict(zip(unit.walks, walk_unit(bundle, unit, grid)))
rows, _ = rows_of(walked, [bundle])
sys.setprofile(None)
files = [getattr(module, "__file__", None) for name, module in sys.modules.items() if name.startswith("stiction.")]
imported = [file for file in files if file and not file.endswith("__init__.py")]
print(json.dumps({"rows": len(rows), "visited": sorted(visited), "imported": len(imported)}))
"""


@pytest.mark.parametrize("engine", MOST)
def test_a_row_goes_through_few_modules(engine: str) -> None:
    """A row's code path has at most these modules, and so many files to read."""
    if engine.startswith("physx") and (missing := missing_engine("physx", find_robot("saturn_lite"))):
        pytest.skip(missing)
    done = subprocess.run([sys.executable, "-c", PROGRAM, engine], capture_output=True, text=True, check=True)
    report = json.loads(done.stdout.splitlines()[-1])
    assert report["rows"] == 1
    modules, rooms = MOST[engine]
    assert len(report["visited"]) <= modules, report["visited"]
    assert len({Path(name).parts[0] for name in report["visited"]}) <= rooms, report["visited"]
    assert "evaluation/grid.py" in report["visited"]
    assert report["imported"] <= MOST_IMPORTED
