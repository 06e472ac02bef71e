"""The code in the key of a walk: a result in a cache is valid as long as none of these files has changed."""

from __future__ import annotations

FLEET = (
    *(
        "core/names.py",
        "core/rotation.py",
        "core/provenance.py",
        "sim/*.py",
        "joints/compensation.py",
        "joints/pd.py",
        "joints/friction.py",
    ),
    *("robots/*.py", "robots/shipped/*.json"),
    *("task/friction.py", "files/method.py", "task/terrain.py", "files/contract.py", "files/known_friction.py"),
    *("files/observation.py", "files/velocity.py", "files/walk.py", "virtual/drive.py"),
    *(
        f"evaluation/{name}.py"
        for name in ("command", "course", "evaluate", "known_friction", "own_policy", "rollout", "metrics")
    ),
)
"""Code that decides the motion of robots under a contract in the simulator of the training."""

WALK_CODE = (
    *(*FLEET, "deploy/*.py", "engines/*.py", "engines/ode/*.py", "virtual/*.py"),
    *("evaluation/grid.py", "evaluation/walks.py"),
)
"""Code that decides the metrics of a bundle's walk; the key has `binaries` of the engine beside it."""

RUN_WALK_CODE = (
    *(*FLEET, "deploy/control.py", "deploy/observation.py"),
    *("learning/models.py", "learning/runner.py", "learning/equivariant.py"),
    *("task/observations.py", "task/randomization.py", "task/symmetry.py"),
    *("task/task_fleet.py", "task/config.py", "virtual/sensors.py", "deploy/check.py"),
    *("evaluation/export.py", "evaluation/trained.py", "evaluation/methods.py"),
)
"""The same of the teacher and the student of a run, both in the simulator of the training; beside it the key has what
`RunDirectory.walks_by` returns. A policy that was exported walks by `WALK_CODE`, wherever its run is."""
