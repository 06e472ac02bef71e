"""What a study has measured and keeps, a file for each part, and by which code a walk is known.

A part is found again by everything that it was made from: its settings, the code that walks and measures, and the
versions of the packages under it. What has changed since is measured anew; old files stay, and are not read.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stiction.formats.errors import StictionError
from stiction.formats.reproducibility import made_by

FLEET = (
    *("sim/*.py", "joints/pd.py", "robots/*.py", "locomotion/friction.py", "locomotion/terrain.py"),
    *(f"formats/{name}.py" for name in ("contract", "friction", "known_friction", "observation", "reproducibility")),
    *(f"transfer/{name}.py" for name in ("command", "course", "evaluate", "known_friction", "record")),
    *(f"transfer/{name}.py" for name in ("rollout", "metrics")),
)
"""Code that decides what robots do under a contract in the simulator of the training, whoever drives them."""

WALKING = (
    *(*FLEET, "deploy/*.py", "transfer/engines/*.py", "transfer/robot/*.py"),
    *("transfer/grid/config.py", "transfer/grid/walk.py"),
)
"""Code that decides what a walk of a bundle is worth; of an engine `binaries` come beside it."""

RUN_WALKING = (
    *(*FLEET, "deploy/observation.py", "rma/models.py", "rma/runner.py"),
    *("locomotion/observations.py", "locomotion/privileged.py", "locomotion/symmetry.py", "rma/equivariant.py"),
    *(f"transfer/{name}.py" for name in ("export", "latents", "run_evaluation", "teacher", "twin", "ways")),
)
"""The same of the teacher and the student of a run, both in the simulator of the training."""


def keep(
    folder: Path, name: str, made_from: dict[str, Any], code: tuple[str, ...], make: Callable[[], dict[str, Any]]
) -> dict[str, Any]:
    """Return a part of a study from its file, which is made first where it is not there.

    Args:
        folder: of the files; it exists.
        name: the part, for people who look into the folder.
        made_from: everything that the part depends on beside code and packages, as JSON takes it.
        code: that makes it, as `made_by` takes it.
        make: returns the part, as JSON takes it.

    Raises:
        StictionError: the file cannot be read or written; and whatever `make` raises.

    """
    key = hashlib.sha256(json.dumps(made_from | made_by(*code), sort_keys=True).encode()).hexdigest()
    file = folder / f"{name}-{key[:12]}.json"
    made = None if file.is_file() else json.dumps(make(), allow_nan=False)
    try:
        if made is not None:
            temporary = file.with_suffix(".tmp")
            temporary.write_text(made, encoding="utf-8")
            temporary.replace(file)
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise StictionError(f"{file} cannot be kept or read: {error}; remove it, or give another --out") from error
