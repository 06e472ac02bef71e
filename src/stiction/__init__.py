"""Dry friction in robot joints: from a log, through training and proof of transfer, to the robot.

The names of `PUBLIC` are the Python API; each is loaded when it is first used, so that importing this package costs
nothing and needs neither torch nor a simulator. Their types are in `__init__.pyi`. See docs/python.md.
"""

import sys
from importlib import import_module
from types import ModuleType
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

ROOMS = ("identify", "evaluate")
"""Names that are both a function and a package: the package can be called."""


def _public(name: str) -> Any:
    """Return what a public name means."""
    return getattr(import_module(f"{__name__}.{PUBLIC[name]}"), name)


class _Callable(ModuleType):
    """A package that is called as the public function of its name."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Call the function."""
        return self.__wrapped__(*args, **kwargs)

    @property
    def __wrapped__(self) -> Any:
        """The function; `inspect.signature` and `help` read it."""
        return _public(self.__name__.rpartition(".")[2])

    @property
    def __doc__(self) -> Any:  # type: ignore[override]
        """The function's docstring."""
        return self.__wrapped__.__doc__


class _Root(ModuleType):
    """The whole package: what Python binds to it when a package of `ROOMS` is imported, can be called."""

    def __setattr__(self, name: str, value: Any) -> None:
        """Bind a name."""
        if name in ROOMS and type(value) is ModuleType:
            value.__class__ = _Callable
        super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        """Return the public names."""
        return sorted(__all__)


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used."""
    if name == "__version__":
        from importlib.metadata import version

        found: Any = version(__name__)
    elif name in ROOMS:
        return import_module(f"{__name__}.{name}")
    elif name in PUBLIC:
        found = _public(name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name, obj=sys.modules[__name__])
    globals()[name] = found
    return found


sys.modules[__name__].__class__ = _Root
