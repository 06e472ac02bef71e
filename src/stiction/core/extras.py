"""Extras of an installation, and the command that adds one from the source of the installation."""

from __future__ import annotations

import importlib.util
import json
import shlex
from collections.abc import Callable
from functools import wraps
from importlib import metadata
from typing import Any, ParamSpec, TypeVar
from urllib.parse import unquote, urlsplit

from stiction.core.errors import ConfigurationError

SIM = ("mujoco", "PIL")
TRAIN = (*SIM, "torch", "rsl_rl", "tensordict", "safetensors", "onnx", "onnxscript", "tensorboard")

EXTRAS = {
    "sim": SIM,
    "train": TRAIN,
    "gpu": (*TRAIN, "mujoco_warp", "warp"),
    "sign": ("cryptography",),
    "logs": ("pyarrow", "rosbags"),
    "engines": (*SIM, "sapien"),
    "unitree": ("cyclonedds",),
    "view": (*SIM, "viser", "mjviser"),
    "wandb": (*TRAIN, "wandb"),
    "trackio": (*TRAIN, "trackio"),
    "mjlab": ("mjlab",),
}
"""Extra -> the packages that it brings, by import name; the smallest extra of a package comes first."""

OLDEST = {"mujoco": ("MuJoCo", "4.0"), "rsl_rl": ("rsl_rl", "5.5")}
"""Package -> its name and the oldest version that simulation and training run with; mjlab 1.6 pins older ones."""

DISTRIBUTIONS = {"rsl_rl": "rsl-rl-lib"}
"""Package -> its distribution, where the names differ."""

EXPERIMENTS = "stiction-experiments"
"""Distribution of the experiments and of the methods of other papers."""


Arguments = ParamSpec("Arguments")
Returned = TypeVar("Returned")


def extra_of(package: str) -> str | None:
    """Return the extra that brings a package, or None."""
    return next((extra for extra, packages in EXTRAS.items() if package in packages), None)


def missing(extra: str) -> tuple[str, ...]:
    """Return the packages of an extra that are not installed, without importing any."""
    return tuple(package for package in EXTRAS[extra] if not is_installed(package))


def is_installed(package: str) -> bool:
    """Return whether a package is installed."""
    try:
        return importlib.util.find_spec(package) is not None
    except (ModuleNotFoundError, ValueError):  # something else forbids it, or it is half loaded
        return False


def require(extra: str) -> None:
    """Raise `ConfigurationError`, with the command to install, where packages of an extra are missing or too old."""
    if (old := outdated(extra)) is not None:
        raise ConfigurationError(old)
    if lacking := missing(extra):
        verb = "is" if len(lacking) == 1 else "are"
        raise ConfigurationError(
            f"this needs the extra {extra!r}, of which {', '.join(lacking)} {verb} not installed; {remedy(extra)}"
        )


def outdated(extra: str = "sim") -> str | None:
    """Return the package of an extra that is too old, and how to have both versions; None if all are recent enough."""
    for package, (name, oldest) in OLDEST.items():
        if package not in EXTRAS[extra]:
            continue
        try:
            version = metadata.version(DISTRIBUTIONS.get(package, package))
        except metadata.PackageNotFoundError:
            continue
        major, minor = (int(number) for number in version.split(".")[:2])
        if (major, minor) < tuple(int(number) for number in oldest.split(".")):
            _, requirement, where = _requirement(f"[{extra}]", installed_from(), "")
            return (
                f"{name} {major}.{minor} is installed; {oldest} is needed: mjlab pins older ones, so leave this "
                f"environment to it and have both with: uv tool install {requirement}{where}; or, in a second virtual "
                f"environment: {install_command(extra, installed_from())}"
            )
    return None


def remedy(extra: str) -> str:
    """Return the command that installs an extra, from the source of this installation.

    mjlab, and everything that needs another MuJoCo than mjlab's, gets a separate environment.
    """
    if (old := outdated(extra)) is not None:
        return old
    if extra == "mjlab":
        command = f"python3 -m venv .venv-mjlab && .venv-mjlab/bin/{install_command(extra, installed_from())}"
        return f"mjlab pins an older MuJoCo, so give it an environment of its own: {command}"
    return f"install it with: {install_command(extra, installed_from(), installed_by())}"


def installed_by() -> str:
    """Return the program that installed the package: `uv`, or `pip`, also where it is unknown."""
    return "uv" if (_noted("INSTALLER") or "").strip() == "uv" else "pip"


def installed_from() -> dict[str, Any] | None:
    """Return the installer's record of the package's source (PEP 610).

    None for a package from an index; empty where no installer recorded anything.
    """
    noted = _noted("direct_url.json")
    if noted is None:
        return None if _noted("INSTALLER") else {}
    try:
        origin = json.loads(noted)
    except ValueError:
        return {}
    return origin if isinstance(origin, dict) else {}


def _noted(file: str) -> str | None:
    try:
        return metadata.distribution("stiction").read_text(file)
    except metadata.PackageNotFoundError:
        return None


def install_command(extra: str, origin: dict[str, Any] | None, installer: str = "pip", part: str = "") -> str:
    """Return the command that adds an extra; `part`: another distribution of the same source, such as the experiments.

    origin: as in `direct_url.json` (a folder, a file, a repository); None: an index; empty: unknown, so the command is
    one for the checkout. installer: `pip` or `uv`, whose environments have no pip; nothing can be added to the
    environment of `uvx`, so the command that runs it again with the extra is named too.
    """
    option, requirement, where = _requirement(f"[{extra}]" if extra else "", origin, part)
    if installer == "uv":
        again = "" if part else f"; or run it as: uvx --from {requirement} stiction ..."
        return f"uv pip install {option}{requirement}{where}{again}"
    return f"pip install {option}{requirement}{where}"


def _requirement(extra: str, origin: dict[str, Any] | None, part: str) -> tuple[str, str, str]:
    """Return three parts of the command: an option, the requirement quoted for the shell, and a remark after it."""
    name = f"stiction-{part}" if part else "stiction"
    if origin is None:
        return "", shlex.quote(f"{name}{extra}"), ""
    url = str(origin.get("url", ""))
    if not url or (part and "archive_info" in origin):
        return "", shlex.quote(f"./{part}{extra}" if part else f".{extra}"), ", in the folder of stiction's source"
    if "dir_info" in origin:
        editable = "-e " if origin["dir_info"].get("editable") else ""
        folder = unquote(urlsplit(url).path) + (f"/{part}" if part else "")
        return editable, shlex.quote(f"{folder}{extra}"), ""
    if "vcs_info" in origin:
        url = f"{origin['vcs_info'].get('vcs', 'git')}+{url}@{origin['vcs_info'].get('commit_id', 'HEAD')}"
        url += f"#subdirectory={part}" if part else ""
    return "", shlex.quote(f"{name}{extra} @ {url}"), ""


def experiments_remedy(extra: str = "") -> str:
    """Return the command that installs the experiments, with one of their extras."""
    return f"install it with: {install_command(extra, installed_from(), installed_by(), 'experiments')}"


def without_experiments(what: str) -> str:
    """Return the message for a verb or method (`what`) of a distribution that is not installed."""
    return f"{what} needs {EXPERIMENTS}, which is not installed; {experiments_remedy()}"


def missing_extra(error: ModuleNotFoundError, what: str) -> str | None:
    """Return the command for a missing package; None where no extra has it. what: the feature that needs it."""
    extra = extra_of((error.name or "").split(".")[0])
    if extra is None:
        return None
    # What a later version has, such as mujoco.batch.
    if "." in (error.name or "") and (old := outdated(extra)) is not None:
        return old
    return f"the package {error.name!r} is not installed; {what} needs the extra {extra!r}; {remedy(extra)}"


def explain_missing(function: Callable[Arguments, Returned]) -> Callable[Arguments, Returned]:
    """Decorate a function to raise `ConfigurationError` with the command to install, where an extra is missing."""

    @wraps(function)
    def called(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Returned:
        try:
            return function(*args, **kwargs)
        except ModuleNotFoundError as error:
            message = missing_extra(error, f"stiction.{function.__name__}")
            if message is None:
                raise
            raise ConfigurationError(message) from error

    return called
