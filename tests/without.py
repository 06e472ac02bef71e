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
from stiction.cli.main import main
{blank}
sys.exit(main({arguments}))
"""

BLANK = """
sys.path.append({tests!r})
from blank_figures import blank_figures
blank = blank_figures()
blank.__enter__()
"""


def run_without(blocked: Collection[str], *arguments: str, figures: bool = True) -> subprocess.CompletedProcess:
    """Run a verb where importing some packages fails; figures: whether it makes any, which shall not be drawn."""
    blank = BLANK.format(tests=str(Path(__file__).parent)) if figures else ""
    code = WITHOUT.format(blocked=set(blocked), arguments=list(arguments), blank=blank)
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
