"""Write the records of the robots that come with the package, from the modules beside this one.

python tools/shipped_robots/write.py        # writes src/stiction/robots/shipped/NAME.json
"""

from __future__ import annotations

import argparse
from pathlib import Path

import g1
import go1
import go2
import saturn_lite

from stiction.robots.record import write_robot

SHIPPED = Path(__file__).parents[2] / "src" / "stiction" / "robots" / "shipped"

ROBOTS = {module.ROBOT.name: module.ROBOT for module in (g1, go1, go2, saturn_lite)}
"""Name -> robot."""


def main() -> None:
    """Write every record."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=SHIPPED, help="folder of the records")
    out = parser.parse_args().out
    for name, robot in ROBOTS.items():
        write_robot(robot, out / f"{name}.json")


if __name__ == "__main__":
    main()
