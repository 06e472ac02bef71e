"""`--method dreamwaq`: its settings and its record. No torch: the command line reads it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from stiction.core.effects import needs
from stiction.core.errors import ConfigurationError
from stiction.files.contract import Contract
from stiction.files.method import Method
from stiction.learning.config import NetworkCfg, TeacherCfg, TrainCfg, check_counts

REPLACED = (
    *("privileged", "recurrent", "estimator_frame", "estimator", "terrain", "terrain_latent", "terrain_loss"),
    "latent",
)
"""Fields of `NetworkCfg` that DreamWaQ's networks take the place of."""

SIZES, LAYERS = ("code", "frame"), ("encoder", "decoder")
"""Fields of `DreamWaQCfg`: single sizes, and lists of layers."""


@dataclass(frozen=True)
class DreamWaQCfg:
    """The context-aided estimator of `--method dreamwaq`, see `stiction_experiments.methods.context`.

    It learns at the rate, and in the passes, of the supervised losses of the first phase. The paper gives the sizes of
    its layers and of the code, and neither β nor what its loss is a mean of.
    """

    beta: float = 0.35
    """Weight of the code's KL divergence, a mean over dimensions, beside the reconstruction, a mean over entries. The
    more, the less the code tells; 0: an autoencoder with noise of its own choice."""
    free_bits: float = field(default=0.05, metadata=needs("--set dreamwaq.beta above 0", lambda cfg: cfg.beta > 0))
    """KL of a dimension below which it costs nothing to tell more [nat]: without it the KL wins before there is
    anything to tell. 0: none."""
    code: int = 16
    """Size of the code."""
    frame: int = 32
    """As network.history_frame, for the encoder. The paper's has no such layer."""
    encoder: tuple[int, ...] = (128, 64)
    """Hidden layers of the encoder, after the frames."""
    decoder: tuple[int, ...] = (64, 128)
    """Hidden layers of the decoder, velocity and code -> the next observation."""

    def __post_init__(self) -> None:
        """Reject sizes and weights out of range."""
        check_counts(*({f"dreamwaq.{name}": getattr(self, name) for name in names} for names in (SIZES, LAYERS)))
        for name in ("beta", "free_bits"):
            if getattr(self, name) < 0:
                raise ConfigurationError(f"dreamwaq.{name} is {getattr(self, name)}; expected at least 0")


def _actor(cfg: TrainCfg) -> dict[str, Any]:
    return {"class_name": "stiction_experiments.methods.context:ContextActor", "context": cfg.method_settings}


def _algorithm(cfg: TrainCfg) -> dict[str, Any]:
    return {"class_name": "stiction_experiments.methods.context_ppo:ContextPPO"}


def _even(cfg: TrainCfg) -> dict[str, int]:
    settings = cfg.method_settings
    sizes = {f"dreamwaq.{name}": getattr(settings, name) for name in SIZES}
    lists = {name: enumerate(getattr(settings, name)) for name in LAYERS}
    return sizes | {f"dreamwaq.{name}[{number}]": size for name, sizes in lists.items() for number, size in sizes}


def _preset(cfg: TrainCfg) -> TrainCfg:
    """Return a preset without what the context takes the place of, and without quiet iterations."""
    usual = NetworkCfg()
    network = replace(cfg.network, **{name: getattr(usual, name) for name in REPLACED})
    teacher = replace(cfg.teacher, quiet=0, velocity_weight=TeacherCfg().velocity_weight)
    return replace(cfg, task=replace(cfg.task, estimated_friction=False), network=network, teacher=teacher)


def _notes(cfg: TrainCfg) -> Iterator[str]:
    if not cfg.task.friction.has_friction:
        yield "dreamwaq trains without dry friction, as in its paper; with: --task.friction.range 0 1.2"


def _called(contract: Contract) -> str:
    """Return the name in results: that of the paper's method, or of the same with friction, which its paper has not."""
    return FRICTIONAL if contract.met_friction else METHOD.name


FRICTIONAL = "dreamwaq-friction"
"""Name in results of DreamWaQ with dry friction in training."""

METHOD = Method(
    "dreamwaq",
    "DreamWaQ: one phase, on a code of the history from a variational autoencoder; without dry friction in the joints "
    "unless a range is named",
    settings=DreamWaQCfg,
    one_phase=True,
    actor=_actor,
    algorithm=_algorithm,
    even=_even,
    preset=_preset,
    unused=("task.estimated_friction", "teacher.velocity_weight", *(f"network.{name}" for name in REPLACED)),
    notes=_notes,
    policy="DreamWaQ's actor",
    called=_called,
    names={
        "dreamwaq": "DreamWaQ: a code of the history in place of teacher and student; conventional randomisation, "
        "without friction",
        FRICTIONAL: "DreamWaQ, with friction in training, drawn from the range that was named",
    },
)
