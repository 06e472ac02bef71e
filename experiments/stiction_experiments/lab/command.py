"""`stiction study`: the experiments behind the results, each one command and one page; and studies of your own."""

from __future__ import annotations

import sys

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.core.help import columns
from stiction.core.options import refuse
from stiction.core.plugins import STUDIES, find_installed, find_named, installed_names
from stiction_experiments.lab.study import Study

WIDTH = 80
"""Columns of the list of studies."""

USAGE = "usage: stiction study NAME [--help] [options]\n\nstudies:"
EPILOG = """
Example:
  stiction study engines --no-walks --out engines

One of your own is `package.module:STUDY`, anywhere on the Python path.
"""


def study_names() -> list[str]:
    """Return the names of the studies: the entry points of the group `stiction.studies`."""
    return installed_names(STUDIES)


def find_study(name: str) -> Study:
    """Return the study called `name`, or the one at `package.module:VARIABLE`.

    Raises:
        ConfigurationError: there is no such module, or it holds no study.

    """
    study = find_named("study", name) if ":" in name else find_installed(STUDIES, name)
    if not isinstance(study, Study):
        raise ConfigurationError(f"study {name!r} is a {type(study).__name__}; expected a Study")
    return study


def overview() -> str:
    """Return the text of `stiction study --help`."""
    begin = 4 + max(map(len, study_names()))
    lines = [columns(f"  {name}", find_study(name).question, WIDTH, begin) for name in study_names()]
    return "\n".join([USAGE, *lines, EPILOG])


def main(arguments: list[str]) -> int:
    """Run one study; return its exit status."""
    name = arguments[0] if arguments else ""
    if name in ("-h", "--help"):
        print(overview(), end="")
        return 0
    names = study_names()
    if name not in names and ":" not in name:
        if name:
            refuse("stiction study", unknown_name("study", name, names))
        print(overview().rstrip(), file=sys.stderr)
        return 2
    return find_study(name).main(arguments[1:], f"study {name}")
