"""The program in a process of its own in which some packages cannot be imported, and no figure is drawn."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Collection
from pathlib import Path

WITHOUT = """
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {blocked}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Refuse())
sys.path.append({tests!r})
from blank_figures import blank_figures
from stiction.cli.main import main
with blank_figures():
    sys.exit(main({arguments}))
"""


def run_without(blocked: Collection[str], *arguments: str) -> subprocess.CompletedProcess:
    """Run a verb where importing some packages fails, and no figure is drawn."""
    tests = str(Path(__file__).parent)
    code = WITHOUT.format(blocked=set(blocked), arguments=list(arguments), tests=tests)
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
