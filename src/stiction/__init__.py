"""Dry friction in robot joints: from a log, through training and proof of transfer, to the robot.

The names of `PUBLIC` are the Python API; each is loaded when it is first used, so that importing this package costs
nothing and needs neither torch nor a simulator. Their types are in `__init__.pyi`. See docs/python.md.
"""

import sys
from importlib import import_module
from typing import Any

PUBLIC = {
    "load_log": "api.logs",
    "from_arrays": "api.logs",
    "identify": "api.identification",
    "excite": "api.excitation",
    "load_joints": "api.identification",
    "list_robots": "api.robot",
    "load_robot": "api.robot",
    "check_robot": "api.robot",
    "check_draws": "core.draws",
    "check_hold": "core.draws",
    "train": "api.training",
    "export": "api.training",
    "list_policies": "api.policy",
    "load_policy": "api.policy",
    "verify": "api.policy",
    "evaluate": "api.evaluation",
    "StictionError": "core.errors",
}
"""Public name -> the module that has it."""

__all__ = ["__version__", *PUBLIC]


def _public(name: str) -> Any:
    """Return what a public name means."""
    return getattr(import_module(f"{__name__}.{PUBLIC[name]}"), name)


def __dir__() -> list[str]:
    """Return the public names."""
    return sorted(__all__)


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used."""
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version(__name__)
    elif name in PUBLIC:
        value = _public(name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name, obj=sys.modules[__name__])
    globals()[name] = value
    return value
