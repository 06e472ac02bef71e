"""Write docs/hero.webp, the film above README.md, and print its caption with the speeds that it shows.

Two shipped policies of one robot walk for eight seconds with the same friction in every joint, see `evaluation.clip`:
the same walk and the same frames every time on one machine; the last bits of both depend on the processor.

    python tools/hero.py
"""

from __future__ import annotations

from pathlib import Path

from stiction.deploy.check import check_for_simulation
from stiction.evaluation.clip import TOGETHER, mean_speed, record_side_by_side, walked
from stiction.files.bundle import shipped_bundles
from stiction.files.velocity import parse_command
from stiction.report.page import COLORS

FILM = Path(__file__).resolve().parents[1] / "docs" / "hero.webp"

POLICIES = {
    "saturn_lite-flat-none-0.2": ("trained without friction", COLORS[0]),
    "saturn_lite-flat-deception-0.2": ("trained with stiction", COLORS[2]),
}
"""Shipped bundle -> its name in the film, and its colour."""

LEVEL, COMMAND = 0.24, "vx=0.5"
"""Friction as a share of the torque limit, the most that the second policy met in training; command."""

CAPTION = (
    "Two simulated hexapods, friction of {level:.0f} % of the torque limit in every joint, told to walk at "
    "{command:g} m/s: trained without friction {without:.2f} m/s, trained with stiction {trained:.2f} m/s."
)


def caption() -> str:
    """Walk as the film does, and return what it shows in a sentence."""
    command, speeds = parse_command(COMMAND), []
    for name in POLICIES:
        bundle = check_for_simulation(shipped_bundles()[name])
        speeds.append(mean_speed(walked(bundle, LEVEL, command, TOGETHER), bundle.contract.control_period))
    return CAPTION.format(level=100 * LEVEL, command=command.velocity[0], without=speeds[0], trained=speeds[1])


def main() -> None:
    """Write the film and print its caption."""
    names, colors = zip(*POLICIES.values(), strict=True)
    record_side_by_side([shipped_bundles()[name] for name in POLICIES], names, colors, LEVEL, COMMAND, FILM)
    print(caption())


if __name__ == "__main__":
    main()
