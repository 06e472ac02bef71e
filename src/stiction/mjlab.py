"""Dry friction for people who train in mjlab: `from stiction.mjlab import with_joints, friction_events`.

Three lines in a training script; docs/trainers.md goes from a log to an answer.
"""

from stiction.core.errors import ConfigurationError
from stiction.core.extras import missing_extra

try:
    from stiction.exchange.mjlab.actuator import IdentifiedActuatorCfg, friction_law_event
    from stiction.exchange.mjlab.draws import audit_draws
    from stiction.exchange.mjlab.friction import DrawFriction, friction_events, friction_told
    from stiction.exchange.mjlab.hold import audit_hold
    from stiction.exchange.mjlab.joints import with_joints
    from stiction.exchange.mjlab.log import StictionLog
except ModuleNotFoundError as error:
    if (message := missing_extra(error, "stiction.mjlab")) is None:
        raise
    raise ConfigurationError(message) from error

__all__ = [
    "DrawFriction",
    "IdentifiedActuatorCfg",
    "StictionLog",
    "audit_draws",
    "audit_hold",
    "friction_events",
    "friction_law_event",
    "friction_told",
    "with_joints",
]
