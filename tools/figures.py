"""Draw the figures of the documents as SVG: python tools/figures.py. They are drawn from rows, from contracts or from
closed forms; what is only named in them is held by the tests of the pages.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs/figures"

BLUE, ORANGE, GREEN, GREY, INK = "#3b6ea8", "#c8702a", "#3f8f5f", "#8a8f98", "#1d2530"


def picture(width: float, height: float, parts: Sequence[str], title: str) -> str:
    """Return an SVG on a white ground; sizes in pixels."""
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}" '
    ground = f'<rect width="{width:g}" height="{height:g}" rx="6" fill="#fff"/>'
    style = f'font-family="Helvetica, Arial, sans-serif" font-size="13" fill="{INK}" role="img"'
    return f"{head}{style}>\n<title>{escape(title)}</title>\n{ground}\n" + "\n".join(parts) + "\n</svg>\n"


def text(x: float, y: float, words: str, colour: str = INK, size: int = 13, anchor: str = "middle") -> str:
    """Return one line of text."""
    style = f'text-anchor="{anchor}" fill="{colour}" font-size="{size}"'
    return f'<text x="{x:g}" y="{y:g}" {style}>{escape(words)}</text>'


def box(x: float, y: float, width: float, height: float, lines: Sequence[str], colour: str = BLUE) -> str:
    """Return a box with lines of text: the first in colour, the others small and grey."""
    first = y + height / 2 + 5 - 8 * (len(lines) - 1)
    drawn = [text(x + width / 2, first, lines[0], colour)]
    drawn += [text(x + width / 2, first + 16 * n, line, "#555c66", 11) for n, line in enumerate(lines[1:], 1)]
    place = f'x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}"'
    return f'<rect {place} rx="5" fill="{colour}" fill-opacity="0.08" stroke="{colour}"/>' + "".join(drawn)


def arrow(points: Sequence[tuple[float, float]], label: str = "", colour: str = GREY) -> str:
    """Return a line with a head at its last point, and a label over the middle of its first part."""
    (x, y), (a, b) = points[-1], points[-2]
    along = 1 if (x, y) > (a, b) else -1
    head = [(x, y), (x - 8 * along, y - 4), (x - 8 * along, y + 4)]
    if x == a:
        head = [(x, y), (x - 4, y - 8 * along), (x + 4, y - 8 * along)]
    line = f'<polyline points="{pairs(points)}" fill="none" stroke="{colour}"/>'
    middle = (points[0][0] + points[1][0]) / 2
    named = text(middle, min(points[0][1], points[1][1]) - 5, label, GREEN, 11) if label else ""
    return f'{line}<polygon points="{pairs(head)}" fill="{colour}"/>{named}'


def pairs(points: Sequence[tuple[float, float]]) -> str:
    """Return points as SVG has them."""
    return " ".join(f"{x:.4g},{y:.4g}" for x, y in points)


def curve(points: Sequence[tuple[float, float]], colour: str, more: str = "") -> str:
    """Return a line through points."""
    return f'<polyline points="{pairs(points)}" fill="none" stroke="{colour}" stroke-width="2" {more}/>'


def chain(title: str, steps: Sequence[tuple[Sequence[str], str]], width: float = 150, gap: float = 46) -> str:
    """Return boxes in a row; each has its lines, and what stands over the arrow behind it."""
    parts, x = [], 12.0
    for number, (lines, label) in enumerate(steps):
        parts.append(box(x, 26, width, 62, lines))
        if number < len(steps) - 1:
            parts.append(arrow([(x + width, 57), (x + width + gap, 57)], label))
        x += width + gap
    return picture(x - gap + 12, 104, parts, title)


def line() -> str:
    """Return the way of the data through the verbs."""
    top, low = 26.0, 140.0
    parts = [
        box(12, top, 110, 50, ["log", "CSV, bag, …"]),
        arrow([(122, top + 25), (200, top + 25)], "identify"),
        box(200, top, 130, 50, ["joints.json", "training.json"]),
        arrow([(330, top + 25), (392, top + 25)], "train"),
        box(392, top, 90, 50, ["run", "checkpoints"]),
        arrow([(482, top + 25), (548, top + 25)], "export"),
        box(548, top, 130, 50, ["policy bundle", "verify, evaluate"]),
        arrow([(678, top + 25), (748, top + 25)], "deploy"),
        box(748, top, 110, 50, ["robot", "real or virtual"]),
        box(200, low, 130, 50, ["your simulator", "mjlab, Isaac Lab, …"], ORANGE),
        arrow([(265, top + 50), (265, low)]),
        text(272, 112, "convert", GREEN, 11, "start"),
        box(548, low, 130, 50, ["others' policy", "ONNX"], ORANGE),
        arrow([(613, low), (613, top + 50)]),
        text(620, 112, "import", GREEN, 11, "start"),
        arrow([(803, top + 50), (803, 212), (67, 212), (67, top + 50)]),
        text(435, 207, "the log of a run is a log again", "#555c66", 11),
    ]
    return picture(870, 226, parts, "log, identify, joints.json, train, run, export, bundle, deploy, robot")


def play(targets: Sequence[float], band: float) -> list[float]:
    """Return the angles of a joint that follows slow targets: it moves only at the edge of the dead band."""
    angles = [0.0]
    for target in targets[1:]:
        angles.append(min(max(angles[-1], target - band), target + band))
    return angles


def dead_band() -> str:
    """Return a slow target and the joint that follows it, for f/kp of a third of the target's amplitude."""
    quarters = [n / 50 for n in range(301)]
    targets = [abs((time + 1) % 4 - 2) - 1 for time in quarters]
    targets = [-target for target in targets]
    start = next(n for n, target in enumerate(targets) if abs(target) < 1e-9)
    targets = targets[start : start + 250]
    band = 1 / 3
    angles = play(targets, band)
    place = [(60 + 1.6 * n, 110 - 70 * y) for n, y in enumerate(targets)]
    moved = [(60 + 1.6 * n, 110 - 70 * y) for n, y in enumerate(angles)]
    edge = [(x, y - 70 * band) for x, y in place], [(x, y + 70 * band) for x, y in reversed(place)]
    parts = [
        f'<polygon points="{pairs([*edge[0], *edge[1]])}" fill="{BLUE}" fill-opacity="0.08"/>',
        curve(place, BLUE, 'stroke-dasharray="5 3"'),
        curve(moved, ORANGE),
        arrow([(60, 206), (470, 206)]),
        text(265, 222, "time, slowly", "#555c66", 11),
        text(480, 60, "target a", BLUE, 13, "start"),
        text(480, 82, "angle θ of the joint", ORANGE, 13, "start"),
        text(480, 104, "within f/kp: it rests", "#555c66", 11, "start"),
    ]
    return picture(640, 232, parts, "a joint stays where it is while its target is within f over kp")


def one_number() -> str:
    """Return what friction is in each trainer: one number, two, or a coefficient of the load."""
    panels = (
        ("one number", ("MuJoCo, mjlab, Playground", "Genesis, Isaac Lab on Newton"), (0.7, 0.7)),
        ("at rest and in motion", ("Isaac Lab on PhysX 5.6 on", 'mjlab by friction="law"'), (1.0, 0.7)),
        ("coefficient of the load", ("PhysX before 5.6", "Isaac Gym, legged_gym"), None),
    )
    parts = []
    for number, (title, names, sizes) in enumerate(panels):
        x = 20 + 220 * number
        parts += [text(x + 95, 22, title, BLUE), arrow([(x, 90), (x + 190, 90)]), arrow([(x + 95, 150), (x + 95, 32)])]
        if sizes:
            rest, moving = (45 * size for size in sizes)
            fall = [(n, moving + (rest - moving) * 2.0 ** (-n / 8)) for n in range(0, 86, 5)]
            right = [(x + 95, 90.0), *((x + 95 + n, 90 - torque) for n, torque in fall)]
            left = [(x + 95, 90.0), *((x + 95 - n, 90 + torque) for n, torque in fall)]
            parts += [curve(right, ORANGE), curve(left, ORANGE)]
        else:
            for load in (0.4, 0.7, 1.0):
                shade = f'stroke-opacity="{load:g}"'
                parts.append(curve([(x + 10, 90 + 45 * load), (x + 95, 90 + 45 * load)], ORANGE, shade))
                parts.append(curve([(x + 95, 90 - 45 * load), (x + 180, 90 - 45 * load)], ORANGE, shade))
        parts += [text(x + 95, 170 + 16 * n, name, "#555c66", 11) for n, name in enumerate(names)]
    parts.append(
        text(
            20,
            212,
            "friction torque over speed of the joint; the three lines on the right: three loads",
            "#555c66",
            11,
            "start",
        )
    )
    return picture(680, 222, parts, "friction over speed, as each trainer takes it")


def methods() -> str:
    """Return the ranges of friction that each method draws around a level of 20 %."""
    from stiction.files.contract_training import FRICTION_RANGES

    level, parts = 20.0, []
    for number, (name, (low, high)) in enumerate(FRICTION_RANGES.items()):
        y, left = 26 + 34 * number, 130 + 16 * level * low
        wide, colour = max(16 * level * (high - low), 3), (GREY, ORANGE, GREEN)[number]
        parts += [
            text(118, y + 15, name, INK, 13, "end"),
            f'<rect x="{left:g}" y="{y:g}" width="{wide:g}" height="20" rx="3" fill="{colour}"/>',
        ]
    for percent in range(0, 25, 4):
        parts.append(text(130 + 16 * percent, 150, f"{percent} %", "#555c66", 11))
    parts.append(
        text(
            130,
            170,
            "dry friction drawn for each robot, of each joint's torque limit; level 20 %",
            "#555c66",
            11,
            "start",
        )
    )
    return picture(580, 182, parts, "ranges of friction by training method")


def rooms() -> str:
    """Return the rooms of the package as the import contract in pyproject.toml has them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    layers = next(
        rule["layers"] for rule in contracts if rule["type"] == "layers" and rule["containers"] == ["stiction"]
    )
    parts = []
    for number, layer in enumerate(layers):
        names = [name.strip() for name in layer.split("|")]
        width = (600 - 6 * (len(names) - 1)) / len(names)
        for place, name in enumerate(names):
            parts.append(box(12 + place * (width + 6), 12 + 34 * number, width, 28, [name]))
    return picture(624, 24 + 34 * len(layers) - 6, parts, "rooms of the package; each imports from those below")


def extras() -> str:
    """Return what each install adds."""
    return chain(
        "installs, each with what is before it",
        [
            (["pip install .", "identify, convert", "verify, deploy"], "+ MuJoCo"),
            (["[sim]", "demo, evaluate", "import"], "+ torch"),
            (["[train]", "train, export"], "+ Warp"),
            (["[gpu]", "train --device cuda"], ""),
        ],
        gap=70,
    )


def supervisor() -> str:
    """Return the processes of a run on a robot, and what passes between them."""
    parts = [
        box(12, 60, 110, 56, ["robot"], ORANGE),
        box(310, 60, 130, 56, ["supervisor", "alone moves the robot"]),
        box(570, 16, 120, 48, ["policy"]),
        box(570, 112, 120, 48, ["logger"]),
        box(310, 170, 130, 48, ["watchdog", "damps without a beat"]),
        arrow([(310, 74), (122, 74)], "commands"),
        arrow([(122, 102), (310, 102)], "states"),
        arrow([(440, 70), (505, 70), (505, 32), (570, 32)]),
        text(540, 26, "sensors", GREEN, 11),
        arrow([(570, 54), (520, 54), (520, 88), (440, 88)]),
        text(545, 68, "targets", GREEN, 11),
        arrow([(440, 106), (505, 106), (505, 136), (570, 136)]),
        text(540, 130, "rows", GREEN, 11),
        arrow([(375, 116), (375, 170)]),
        text(382, 148, "beat", GREEN, 11, "start"),
        arrow([(310, 194), (67, 194), (67, 116)]),
        text(190, 188, "damping", GREEN, 11),
    ]
    return picture(702, 230, parts, "supervisor, policy, logger and watchdog")


CHAINS: dict[str, Callable[[], str]] = {
    "bring-up": lambda: chain(
        "from the bundle to the floor",
        [
            (["verify --against", "axes, signs, order"], ""),
            (["virtual robot", "other joints, friction"], ""),
            (["dry run, in the air", "report.json, log"], ""),
            (["armed, in the air", "stand, 5 s"], ""),
            (["floor", "identify the log"], ""),
        ],
    ),
    "day": lambda: chain(
        "a day on the bench",
        [
            (["1 identify", "in the air, 1 h each"], ""),
            (["2 train", "36 to 75 min each"], ""),
            (["3 predict", "before any walk"], ""),
            (["4 walk", "3 h, three runs each"], ""),
            (["5 the page", "reached beside predicted"], ""),
        ],
    ),
    "own-robot": lambda: chain(
        "a robot of your own",
        [
            (["robot.xml or .urdf", "links, masses, limits"], "+ YAML"),
            (["robot.yaml", "torque limit, armature", "gains, pose"], "check"),
            (["derived, with source", "feet, height, mirror", "gait groups"], "train"),
            (["run", "robot.json"], "export"),
            (["contract.json", "keeps the robot"], ""),
        ],
        gap=56,
    ),
    "policies": lambda: chain(
        "policies in and out",
        [
            (["ONNX of others", "mjlab, rl_sar", "unitree_rl_lab, …"], "import"),
            (["policy bundle", "contract, golden steps"], "verify"),
            (["checked", "runs as recorded"], "evaluate"),
            (["follows at …", "command by friction"], "export --to"),
            (["deploy.yaml, rl_sar", "mjlab, Webots"], ""),
        ],
        gap=62,
    ),
}

FIGURES: dict[str, Callable[[], str]] = {
    "line": line,
    "dead-band": dead_band,
    "one-number": one_number,
    "methods": methods,
    "rooms": rooms,
    "extras": extras,
    "supervisor": supervisor,
    **CHAINS,
}
"""Name of a file -> what draws it."""


def main() -> None:
    """Draw all figures."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    FOLDER.mkdir(exist_ok=True)
    for name, draw in FIGURES.items():
        (FOLDER / f"{name}.svg").write_text(draw(), encoding="utf-8")


if __name__ == "__main__":
    main()
