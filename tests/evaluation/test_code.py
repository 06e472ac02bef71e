"""Code in the keys of walks: modules that determine a walk are in its key, modules that only transport it are not."""

from __future__ import annotations

import pytest

from source_tree import BY_NAME, NAMES, all_imports
from stiction.core.provenance import source_files
from stiction.evaluation.evaluate import RUN_WALK_CODE, WALK_CODE
from stiction.virtual.bench import BENCH_CODE
from stiction_experiments.wear.run import WEARING

TRAINED = (*RUN_WALK_CODE, "stiction_experiments:lab/trained.py")
"""Code of the walks of a run's policies, including the experiment's use of them."""

BY_FILE = {name: path for path, name in NAMES.items()}
"""Path below the package -> module."""

READING = {
    *("core/cache.py", "core/effects.py", "core/errors.py", "core/gemm.py", "core/isolation.py", "core/statistics.py"),
    *(
        "core/lifeline.py",
        "core/lock.py",
        "core/memory.py",
        "core/scratch.py",
        "files/text.py",
    ),
    *(f"files/{name}.py" for name in ("actuator", "bundle", "contract_rules", "following", "golden", "joint_map")),
    "files/contract_training.py",
    "core/decode.py",
    *(f"files/{name}.py" for name in ("bam", "joints", "log", "plain", "results", "signature", "tables")),
    *(
        "core/extras.py",
        "core/flags.py",
        "core/yaml_files.py",
        "core/files.py",
        "core/plugins.py",
        "core/records.py",
        "task/config.py",
        "task/rewards.py",
        "joints/net.py",
    ),
}
"""Code that reads and refuses files, whose content is in every key, or names columns and methods; finds what a user
named; speed; configuration, whose values are in every key, and rewards, which no walk reads."""

CHECKING = {f"deploy/{name}.py" for name in ("check", "first_run", "network_file", "operators", "plausibility")}
"""Code that rejects a policy or a command, or passes it unchanged."""

WEAR = {"files/wear.py", "deploy/wear.py"}
"""The monitor, which only listens."""

BENCHES = {
    *(name for name in NAMES.values() if name.startswith("identification/")),
    *("evaluation/benches.py", "files/advice.py", "joints/simulate.py", "joints/stick_slip.py", "joints/variation.py"),
    *("core/linear.py", "core/parallel.py", "evaluation/run.py", "evaluation/policies.py"),
}
"""Code of benches, whose numbers are in the key of each walk that is told them; and who does which walk."""

TRAINING = {
    *(f"task/{name}.py" for name in ("env", "events")),
    *(f"learning/{name}.py" for name in ("config", "figures", "health", "identity", "phase", "ppo", "quick", "run")),
    *("learning/ranks.py", "learning/begin.py", "learning/symmetry.py", "deploy/vendor.py"),
    *("learning/boards.py", "learning/stored.py", "evaluation/reward_meter.py"),
    *(name for name in NAMES.values() if name.startswith("engines/")),
    *("core/linear.py", "learning/begin.py", "task/load_law.py"),
    *(*(CHECKING - {"deploy/check.py"}), "deploy/policy.py", "evaluation/golden.py"),
}
"""Code that trained, shows, exports and drives, which the modules around a run's policies import: weights and settings
are in keys."""

BENCHED = {
    *("files/contract.py", "files/known_friction.py", "files/observation.py", "files/velocity.py"),
    "files/walk.py",
    *(
        "task/friction.py",
        "files/method.py",
        "task/terrain.py",
        *CHECKING,
        "deploy/observation.py",
        "deploy/policy.py",
    ),
    *(f"sim/{name}.py" for name in ("fleet", "native")),
    *(f"identification/logs/{name}.py" for name in ("naming", "titles")),
}
"""Code of walks, of the design of logs, and of the names in logs of others: the robot on its stand shares modules with
the one that walks, and its own logs have the names of its joints."""


def imported(start: str) -> set[str]:
    """Return every module of the package that a module leads to, itself included, at the top of modules or inside."""
    seen, waiting = {BY_FILE[start]}, [BY_FILE[start]]
    while waiting:
        path = waiting.pop()
        names = {name for name, _ in all_imports(path)}
        names |= {name.rpartition(".")[0] for name in names}
        new = {BY_NAME[name] for name in names if name in BY_NAME} - seen
        seen |= new
        waiting += new
    return {NAMES[path] for path in seen if path.name != "__init__.py"}


def counted(code: tuple[str, ...]) -> set[str]:
    """Return the modules that patterns name."""
    return {NAMES[file] for pattern in code for file in source_files(pattern) if file.suffix == ".py"}


@pytest.mark.parametrize(
    ("start", "code", "known"),
    [
        ("evaluation/grid.py", WALK_CODE, READING | WEAR | BENCHES),
        ("stiction_experiments:wear/lifetimes.py", WEARING, READING | {"stiction_experiments:lab/straight.py"}),
        ("stiction_experiments:lab/trained.py", TRAINED, (READING - {"task/config.py"}) | TRAINING | WEAR),
        ("virtual/bench.py", BENCH_CODE, READING | BENCHED | WEAR),
    ],
)
def test_code_that_decides_is_in_the_key(start: str, code: tuple[str, ...], known: set[str]) -> None:
    """A change of the random streams, or of how gains are read, changes the key."""
    assert sorted(imported(start) - counted(code) - known) == []


@pytest.mark.parametrize("code", [WALK_CODE, RUN_WALK_CODE, WEARING, BENCH_CODE])
def test_every_part_of_the_walking_code_is_there(code: tuple[str, ...]) -> None:
    """Every named file exists: a renamed file would silently leave the keys."""
    assert [pattern for pattern in code if not source_files(pattern)] == []


@pytest.mark.parametrize(
    ("code", "files"),
    [
        (WALK_CODE, ("deploy/observation.py", "deploy/policy.py", "robots/physics.py", "engines/physx.py")),
        (RUN_WALK_CODE, ("deploy/check.py", "task/config.py", "task/observations.py")),
        *((code, ("virtual/drive.py", "sim/fleet.py", "joints/pd.py")) for code in (WALK_CODE, RUN_WALK_CODE)),
    ],
)
def test_what_is_known_to_decide_walks_counts(code: tuple[str, ...], files: tuple[str, ...]) -> None:
    """A change of start poses, sensor noise, observations, actions or friction changes the key."""
    assert sorted({*files} - counted(code)) == []
