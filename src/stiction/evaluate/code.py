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
    *("robots/*.py", "robots/shipped/*.py"),
    *("locomotion/friction.py", "locomotion/terrain.py", "formats/contract.py", "formats/known_friction.py"),
    *("formats/observation.py", "formats/velocity.py", "formats/walk.py"),
    *(
        f"evaluate/{name}.py"
        for name in ("command", "course", "evaluate", "known_friction", "own_policy", "rollout", "metrics")
    ),
)
"""Code that decides the motion of robots under a contract in the simulator of the training."""

WALK_CODE = (
    *(*FLEET, "deploy/*.py", "engines/*.py", "engines/ode/*.py", "virtual/*.py"),
    *("evaluate/grid.py", "evaluate/run.py"),
)
"""Code that decides the metrics of a bundle's walk; the key has `binaries` of the engine beside it."""

RUN_WALK_CODE = (
    *(*FLEET, "deploy/observation.py"),
    *("rma/models.py", "rma/context.py", "rma/runner.py", "rma/equivariant.py"),
    *("locomotion/observations.py", "locomotion/randomization.py", "locomotion/symmetry.py"),
    *("locomotion/task_fleet.py", "locomotion/config.py", "virtual/sensors.py", "deploy/check.py"),
    *("evaluate/export.py", "evaluate/trained.py", "evaluate/methods.py"),
)
"""The same of the teacher and the student of a run, both in the simulator of the training; beside it the key has what
`RunDirectory.walks_by` returns. A policy that was exported walks by `WALK_CODE`, wherever its run is."""
