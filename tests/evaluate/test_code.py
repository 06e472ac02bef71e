"""By which code a result counts: what decides a walk is in its key, and what only carries it is not."""

from __future__ import annotations

import pytest

from stiction.core.provenance import PACKAGE
from stiction.evaluate.code import RUN_WALK_CODE, WALK_CODE
from stiction.studies.wear.run import WEARING
from stiction.virtual.bench import BENCH_CODE
from test_house import BY_NAME, NAMES, all_imports

BY_FILE = {name: path for path, name in NAMES.items()}
"""Path below the package -> module."""

READING = {
    *("core/cache.py", "core/errors.py", "core/gemm.py", "core/isolation.py", "core/statistics.py"),
    *(
        "core/cluster.py",
        "core/lifeline.py",
        "core/lock.py",
        "core/memory.py",
        "core/scratch.py",
        "formats/dialect.py",
        "formats/text.py",
    ),
    *(f"formats/{name}.py" for name in ("actuator", "bundle", "contract_rules", "following", "golden", "joint_map")),
    *(f"formats/{name}.py" for name in ("joints", "log", "plain", "results", "signature", "tables")),
    *(
        "deploy/silent.py",
        "core/extras.py",
        "core/files.py",
        "core/plugins.py",
        "core/records.py",
        "locomotion/config.py",
        "locomotion/rewards.py",
        "joints/net.py",
    ),
}
"""Code that reads and refuses files, whose content is in every key, or names columns and methods; finds what a user
named; speed; configuration, whose values are in every key, and rewards, which no walk reads."""

CHECKING = {
    f"deploy/{name}.py" for name in ("check", "first_run", "network_file", "operators", "plausibility", "violation")
}
"""Code that refuses a policy or a command, or lets it walk as it is."""

WEAR = {"formats/wear.py", "deploy/wear.py"}
"""The monitor, which only listens."""

BENCHES = {
    *(name for name in NAMES.values() if name.startswith("identify/")),
    *("evaluate/benches.py", "formats/advice.py", "joints/simulate.py", "joints/stick_slip.py", "joints/variation.py"),
    *("core/parallel.py", "evaluate/code.py", "evaluate/methods.py"),
}
"""Code of benches, whose numbers are in the key of each walk that is told them; and who does which walk."""

TRAINING = {
    *(f"locomotion/{name}.py" for name in ("commands", "device", "env", "gait")),
    *(
        f"rma/{name}.py"
        for name in ("config", "figures", "health", "hinf_config", "identity", "phase", "ppo", "quick", "run")
    ),
    *("rma/ranks.py", "rma/simulator.py", "rma/symmetry.py", "deploy/vendor.py"),
    *(name for name in NAMES.values() if name.startswith("engines/")),
    *(*(CHECKING - {"deploy/check.py"}), "deploy/pilot.py", "deploy/policy.py", "evaluate/golden.py"),
}
"""Code that trained, exports and drives, which the modules around a run's policies import: weights and settings are in
keys."""

BENCHED = {
    *("formats/contract.py", "formats/known_friction.py", "formats/observation.py", "formats/velocity.py"),
    "formats/walk.py",
    *(
        "locomotion/friction.py",
        "locomotion/terrain.py",
        *CHECKING,
        "deploy/observation.py",
        "deploy/policy.py",
    ),
    *(f"sim/{name}.py" for name in ("fleet", "native", "protocol", "slider")),
    *("identify/excite/fisher.py", "identify/excite/setup.py"),
}
"""Code of walks, and of the design of logs: the robot on its stand shares modules with the one that walks."""


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


@pytest.mark.parametrize(
    ("start", "code", "known"),
    [
        ("evaluate/run.py", WALK_CODE, READING | WEAR | BENCHES),
        ("studies/wear/lifetimes.py", WEARING, READING),
        ("evaluate/trained.py", RUN_WALK_CODE, (READING - {"locomotion/config.py"}) | TRAINING | WEAR),
        ("virtual/bench.py", BENCH_CODE, READING | BENCHED | WEAR),
    ],
)
def test_code_that_decides_is_in_the_key(start: str, code: tuple[str, ...], known: set[str]) -> None:
    """A change of the random streams, or of how gains are read, would pass for the old results."""
    counted = {file.relative_to(PACKAGE).as_posix() for pattern in code for file in PACKAGE.glob(pattern)}
    assert sorted(imported(start) - counted - known) == []


@pytest.mark.parametrize("code", [WALK_CODE, RUN_WALK_CODE, WEARING, BENCH_CODE])
def test_every_part_of_the_walking_code_is_there(code: tuple[str, ...]) -> None:
    """A file that was renamed would no longer count, and nobody would see it."""
    assert [pattern for pattern in code if not list(PACKAGE.glob(pattern))] == []


@pytest.mark.parametrize(
    ("code", "files"),
    [
        (WALK_CODE, ("deploy/observation.py", "deploy/policy.py", "robots/physics.py", "engines/physx.py")),
        (RUN_WALK_CODE, ("deploy/check.py", "locomotion/config.py", "locomotion/observations.py")),
        *((code, ("virtual/sensors.py", "sim/friction.py", "joints/pd.py")) for code in (WALK_CODE, RUN_WALK_CODE)),
    ],
)
def test_what_is_known_to_decide_walks_counts(code: tuple[str, ...], files: tuple[str, ...]) -> None:
    """Start poses and sensor noise, observations, actions, friction: a change of one is another walk."""
    counted = {file.relative_to(PACKAGE).as_posix() for pattern in code for file in PACKAGE.glob(pattern)}
    assert sorted({*files} - counted) == []
