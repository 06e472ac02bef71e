"""Training methods: the product's, and those of installed distributions (entry points of `stiction.methods`).

Command lines and files hold the name of a method; its record lists its changes to a training. No torch: networks and
algorithms have their names in rsl_rl, `package.module:Class`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.core.extras import without_experiments
from stiction.core.plugins import METHODS, find_installed, installed_names
from stiction.files.contract_rules import IMPORTED
from stiction.files.contract_training import FRICTION_RANGES

TrainCfg = Any
"""`stiction.learning.config.TrainCfg`, whose room is above this one."""

Mixture = tuple[tuple[float, float, float], ...]
"""Mixture of uniform distributions: (weight, lower end, upper end) of each."""

FRICTIONLESS: Mixture = ((1.0, 0.0, 0.0),)


@dataclass(frozen=True)
class Stage:
    """Part of the teacher's training, up to the next stage."""

    begin: float
    """Share of the teacher's iterations before it."""
    mixture: Mixture

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest multiplier."""
        return min(low for _, low, _ in self.mixture), max(high for _, _, high in self.mixture)


def stages_of(final: Mixture, begin: float, count: int) -> tuple[Stage, ...]:
    """Return the schedule that ends with a distribution.

    begin: share of the iterations without friction before; count: equal stages in which friction grows.
    """
    growing = tuple(
        Stage(
            begin + (1.0 - begin) * k / count,
            tuple((weight, low * (k + 1) / count, high * (k + 1) / count) for weight, low, high in final),
        )
        for k in range(count)
    )
    return (Stage(0.0, FRICTIONLESS), *growing) if begin else growing


@dataclass(frozen=True)
class Method:
    """Training method. Callables get the configuration of a training (`stiction.learning.config.TrainCfg`)."""

    name: str
    description: str
    """Friction in training, in words."""
    friction_range: tuple[float, float] = (0.0, 0.0)
    """Multiplier of the nominal dry friction in the last stage, unless the configuration has another."""
    begin: float = 0.0
    """Share of the teacher's iterations before there is friction, unless the configuration has another."""
    stages: int = 1
    """Equal stages in which friction grows, likewise."""
    compensation: str | None = None
    """Friction added to the command, as `parse_compensation` reads it; None: none."""
    settings: type[Any] | None = None
    """Frozen dataclass of its settings, which all have defaults; or None."""
    one_phase: bool = False
    """True if it learns in one phase, on the student's observations."""
    actor: Callable[[TrainCfg], Mapping[str, Any]] | None = None
    """rsl_rl's configuration of its actor: `class_name` and arguments; None: the actor of rapid motor adaptation."""
    algorithm: Callable[[TrainCfg], Mapping[str, Any]] | None = None
    """rsl_rl's configuration of its algorithm, a subclass of `AdaptationPPO`, whose `figures` are recorded in every
    iteration; it trains in one process. None: `AdaptationPPO`."""
    acts_on_fleet: bool = False
    """True if it acts on the simulated robots in addition to the policy: on the host and in MuJoCo only."""
    even: Callable[[TrainCfg], Mapping[str, int]] | None = None
    """Sizes of its networks, by name, that symmetric networks split into halves; None: the usual networks."""
    check: Callable[[TrainCfg], None] = lambda cfg: None
    """Function that raises `ConfigurationError` for a configuration that cannot be trained."""
    preset: Callable[[TrainCfg], TrainCfg] = lambda cfg: cfg
    """Preset -> preset for this method; the method itself is not set."""
    unused: tuple[str, ...] = ()
    """Paths of settings of other methods without an effect in this one."""
    notes: Callable[[TrainCfg], Iterator[str] | tuple[()]] = lambda cfg: ()
    """Sentences for the user at the begin of a run."""
    policy: str = "the student of rapid motor adaptation"
    """Kind of its policies, for the card of a bundle."""
    contract: Callable[[TrainCfg], Mapping[str, Any]] = lambda cfg: {}
    """Further fields of its policies' contracts."""
    called: Callable[[Any], str] | None = None
    """Contract -> name of the method in results, a key of `names`; None: its name."""
    names: Mapping[str, str] | None = None
    """Name in results -> description; None: its name and its description."""


OWN = {
    method.name: method
    for method in (
        Method("none", "conventional domain randomisation, without dry friction in the joints"),
        *(
            Method(name, f"dry friction in the joints, drawn {how} its nominal value", FRICTION_RANGES[name])
            for name, how in (("direct", "closely around"), ("deception", "from zero up to above"))
        ),
    )
}


EXPERIMENTAL = ("compensation", "dreamwaq", "finetune", "hinf", "iterative")
"""Methods of the distribution of the experiments, known by name if it is not installed."""


def method_names() -> list[str]:
    """Return the names of all methods: the product's, then all others in alphabetical order."""
    return [*OWN, *sorted({*EXPERIMENTAL, *installed_names(METHODS)} - OWN.keys())]


def installed_methods() -> list[Method]:
    """Return the installed methods of other distributions, in alphabetical order.

    One that fails to load is left out: its error appears only to users who name it.
    """
    methods = []
    for name in method_names()[len(OWN) :]:
        with suppress(ConfigurationError):
            methods += [method for method in (known_method(name),) if method is not None]
    return methods


@cache
def known_method(name: str) -> Method | None:
    """Return a method by its name; None if it is not installed. Raises `ConfigurationError` if it is broken."""
    method = OWN.get(name) or find_installed(METHODS, name)
    if method is not None and not (isinstance(method, Method) and method.name == name):
        raise ConfigurationError(f"entry point {name!r} of {METHODS}: got no method of this name; reinstall it")
    return method


def describe_method(name: str) -> str:
    """Return a method in words; the name of one that is not installed."""
    if name == IMPORTED:
        return "trained elsewhere; what friction it met is not known"
    method = known_method(name)
    return name if method is None else method.description


def find_method(name: str) -> Method:
    """Return a method by its name. Raises `ConfigurationError` for an unknown one, or one that is not installed."""
    if (method := known_method(name)) is not None:
        return method
    if name in EXPERIMENTAL:
        raise ConfigurationError(without_experiments(f"the method {name!r}"))
    raise ConfigurationError(unknown_name("friction method", name, method_names()))
