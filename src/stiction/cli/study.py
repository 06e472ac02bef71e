"""`stiction study`: the experiments behind the results, each one command and one page."""

from __future__ import annotations

import importlib
import sys

STUDIES: dict[str, str] = {
    "stairs": "how high a policy climbs, without and with joint friction",
    "gait": "which feet are down when, with and without the two gait rewards",
    "damping": "B and k·kd as one number to a joint: where that holds, and where it fails",
    "adaptation": "what a student's latent z* does, and whether it tells the friction of the joints",
    "actuator": "the loop of an Actuator Net: f0, log, f_motor, f1",
    "bench": "what identification finds of virtual robots on their benches, held against the truth",
    "engines": "whether every physics engine does what it should, and how the same policy walks in each",
    "friction": "which way to train with joint friction works, and at how much of it; a verdict a claim",
    "physics": "what a faster simulation of joint friction does to the speed of a walk",
    "wear": "how long a policy lives while friction grows, and whether its monitor notices in time",
}
"""Study -> what it answers. The module is `stiction.cli.studies.<name>`."""

USAGE = "usage: stiction study NAME [--help] [options]\n\nstudies:\n"


def overview() -> str:
    """Return the text of `stiction study --help`."""
    return USAGE + "".join(f"  {name:<12}{text}\n" for name, text in STUDIES.items())


def main(arguments: list[str]) -> int:
    """Run one study; return its exit status."""
    name = arguments[0] if arguments else ""
    if name in ("-h", "--help"):
        print(overview(), end="")
        return 0
    if name not in STUDIES:
        said = f"stiction study: unknown study {name!r}" if name else overview().rstrip()
        print(f"{said}{'; the studies are: ' + ', '.join(STUDIES) if name else ''}", file=sys.stderr)
        return 2
    return int(importlib.import_module(f"stiction.cli.studies.{name}").main(arguments[1:]) or 0)
