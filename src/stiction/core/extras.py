"""Packages that only some installations have, and the sentence where one of them is missing."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from stiction.core.errors import ConfigurationError

EXTRAS = {"mujoco": "sim", "PIL": "sim", "yaml": "sim", "torch": "train", "rsl_rl": "train", "tensordict": "train"}
EXTRAS |= {"safetensors": "train", "onnx": "train", "onnxscript": "train", "tensorboard": "train"}
EXTRAS |= {"mujoco_warp": "gpu", "warp": "gpu", "cryptography": "sign", "viser": "view", "mjviser": "view"}
"""Package -> the extra that installs it."""

Arguments = ParamSpec("Arguments")
Returned = TypeVar("Returned")


def missing_extra(error: ModuleNotFoundError, what: str) -> str | None:
    """Return what to install for the package that is missing; None where no extra has it. what: that which needs it."""
    extra = EXTRAS.get((error.name or "").split(".")[0])
    if extra is None:
        return None
    return (
        f"the package {error.name!r} is not installed; {what} needs the extra {extra!r}: "
        f'pip install "stiction[{extra}]"'
    )


def says_what_is_missing(function: Callable[Arguments, Returned]) -> Callable[Arguments, Returned]:
    """Have a function raise `ConfigurationError`, with what to install, where the package of an extra is missing."""

    @wraps(function)
    def called(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Returned:
        try:
            return function(*args, **kwargs)
        except ModuleNotFoundError as error:
            said = missing_extra(error, f"stiction.{function.__name__}")
            if said is None:
                raise
            raise ConfigurationError(said) from error

    return called
