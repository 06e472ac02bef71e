"""The page of `stiction demo`: the whole line from a log to checked policies, for somebody who has seen none of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from markupsafe import Markup

from stiction.deploy.check import BundleCheck
from stiction.files.bundle import Bundle
from stiction.files.following import DEFINITION
from stiction.files.joints import JointRecord
from stiction.files.method import describe_method
from stiction.files.results import ResultRow
from stiction.joints.friction import level_text
from stiction.report.evaluation import (
    COMMAND_MAP,
    FILES,
    budget_picture,
    definitions_table,
    draw_budget,
    results_table,
    run_blocks,
)
from stiction.report.following import command_map, followed_text
from stiction.report.page import Section, file_uri, paragraph, picture, render_page, table

RESULTS = (
    *("report.html", "side-by-side.webp", "example/shank.csv", "example/shank.json", "example/joints.json"),
    *(f"evaluation/{name}" for name in FILES),
)
"""Files that the demo writes, without the measured record that the user provides."""


@dataclass(frozen=True)
class DemoJoint:
    """One identified joint."""

    title: str
    """Name of the joint, and origin of its log."""
    command: str
    """The command that identified it."""
    name: str
    """The joint's name in the log."""
    record: JointRecord
    """Identified quantities, with verdict and warnings."""
    blocks: tuple[Markup, ...]
    """Table and pictures of the identification."""


Policies = Mapping[str, BundleCheck]
"""Name of a policy on the page, see `policy_names` -> the policy, checked."""

Clips = tuple[str, float, Path | None]
"""Command and friction level of the clip, and all policies in one scene; None where it could not be rendered."""


def policy_names(bundles: Sequence[Bundle]) -> list[str]:
    """Return what policies are called: by the friction that they met in training, and their own name among equals."""
    words = [f"trained {bundle.contract.trained}" for bundle in bundles]
    return [
        f"{text} ({bundle.name})" if words.count(text) > 1 else text
        for text, bundle in zip(words, bundles, strict=True)
    ]


def render_demo(
    joints: Sequence[DemoJoint],
    policies: Policies,
    rows: Sequence[ResultRow],
    summary: dict[str, Any],
    clips: Clips,
    warnings: Sequence[str] = (),
) -> str:
    """Return the page as one HTML text.

    policies: in the order of the page; may be empty. summary: what was run, as in summary.json; `policies` is empty
    where none was evaluated. warnings: what was left out, and why.
    """
    sections = [Section("What is this about?", tuple(map(paragraph, INTRODUCTION))), *map(_joint_section, joints)]
    lead: Sequence[str] = (NO_POLICY,)
    opening: tuple[Markup, ...] = ()
    if policies:
        lead = verdict(policies, rows)
        heading = "Three ways to train, one robot" if len(policies) == 3 else "The policies"
        called = {check.bundle.name: name for name, check in policies.items()}
        rows = [replace(row, policy=called[row.policy]) for row in rows]
        own = {name: [row for row in rows if row.policy == name] for name in policies}
        maps = [block for name in policies for block in command_map(own[name], name.capitalize()).blocks()]
        budget = budget_picture(draw_budget(rows)), paragraph(BUDGET_TEXT), paragraph(COMMAND_MAP), *maps
        sections += [
            Section(heading, _policy_blocks(policies)),
            Section("How much friction each of them bears", budget),
            Section("Are these files what they claim to be?", _check_blocks(policies)),
            Section("Every number", (results_table(rows), definitions_table(rows))),
            Section("What was run", run_blocks(summary)),
        ]
        opening = *_film(clips), budget_picture(draw_budget([r for r in rows if r.command == clips[0]]))
    sections.append(Section("Go on from here", (table(["you want to", "command"], NEXT_STEPS),)))
    return render_page(TITLE, sections, lead, warnings, summary["command"], opening=opening)


TITLE = "Dry friction in robot joints, from a log to a policy"


NO_POLICY = "A joint was identified. No policy was evaluated."

NEXT_STEPS = (
    ("identify a joint of your own", "stiction identify LOG.csv --kp 20 --kd 0.5 --torque-limit 25"),
    ("train a policy that copes with 20 %", "stiction train --preset quick --method deception --friction-level 0.2"),
    ("make a bundle of it", "stiction export runs/train"),
    ("check a bundle", "stiction verify BUNDLE"),
    ("see what it bears", "stiction evaluate BUNDLE --friction-levels 0 0.1 0.2 0.3"),
)

INTRODUCTION = (
    "A joint with dry friction does not move until the motor pushes harder than the friction. The simulators in which "
    "legged robots learn to walk often leave that out. The robot then learns with joints that it does not have.",
    "Two numbers say how bad it is: friction over the motor's largest torque, f/τ_max, and the dead band, f/kp: the "
    "error of position below which a position-controlled joint does nothing at all.",
    "This page finds the friction in a log, says whether it matters, and compares policies that were trained with and "
    "without it. Every identification and every walk on it was computed just now, on this machine.",
)

METHODS_TEXT = (
    "One robot ({robots}) and policies that differ in the dry friction that its joints had while they learned, as a "
    "share of the joints' torque limit:"
)

BUDGET_TEXT = (
    "Read it from left to right, towards more friction in the joints: every policy gets slower. One that was trained "
    "without friction leaves the green band at its lower edge; one that was trained with much of it may begin above. "
    f"{DEFINITION}"
)

CHECK_TEXT = (
    "A policy is a folder of five files: the network, a contract that says what it expects of the robot, recorded "
    "sensors with the answers that the network gave, digests, and a card. Before a policy is used, the digests are "
    "compared and the recording is replayed:"
)


def _joint_section(joint: DemoJoint) -> Section:
    """Return one identification."""
    notes = (paragraph(f"Warning: {warning}") for warning in joint.record.warnings)
    verdict = map(paragraph, joint.record.diagnostics["verdict"]["lines"])
    blocks = *verdict, *notes, *joint.blocks, paragraph(f"By hand: {joint.command}")
    return Section(f"Friction from a log: {joint.title}", blocks)


def _policy_blocks(policies: Policies) -> tuple[Markup, ...]:
    """Return how the policies were trained."""
    contracts = {name: check.bundle.contract for name, check in policies.items()}
    cells = [
        (
            name,
            describe_method(contract.method),
            contract.method,
            "{:g} to {:g} %".format(*(100 * end for end in contract.friction_range)),
            str(contract.seed),
        )
        for name, contract in contracts.items()
    ]
    robots = ", ".join(dict.fromkeys(contract.robot for contract in contracts.values()))
    return (
        paragraph(METHODS_TEXT.format(robots=robots)),
        table(["policy", "meaning", "method", "friction in training [of τ_max]", "seed"], cells),
    )


def verdict(policies: Policies, rows: Sequence[ResultRow]) -> list[str]:
    """Return a line for each policy: at which friction it follows all commands that were walked, else the worst."""
    own = {name: [row for row in rows if row.policy == check.bundle.name] for name, check in policies.items()}
    commands = ", ".join(dict.fromkeys(row.command for row in rows))
    lines = [f"{name.capitalize()}, it {followed_text(walked)}." for name, walked in own.items()]
    return [*lines, f"Walked here: {commands}; stiction evaluate walks all fifteen commands."]


def _film(clips: Clips) -> tuple[Markup, ...]:
    """Return the film, where it could be rendered."""
    command, level, file = clips
    friction = level_text("coulomb", level)
    return () if file is None else (picture(file_uri(file), SCENE.format(friction=friction, command=command)),)


SCENE = (
    "{friction} of the torque limit as friction in every joint, command {command} m/s, one start line; a line on the "
    "ground is a metre. In real time."
)
"""Caption of the film."""


def _check_blocks(policies: Policies) -> tuple[Markup, ...]:
    """Return what the check of each bundle found."""
    cells = []
    for check in policies.values():
        replay = f"{check.steps} steps, {max(check.action_error, check.target_error):.0e}"
        bundle = check.bundle
        cells.append((bundle.name, f"{bundle.size / 1e6:.2f} MB", replay, bundle.digest[:16]))
    return (
        paragraph(CHECK_TEXT),
        table(["bundle", "size", "replay, largest difference", "digest"], cells),
        paragraph("The digests guard against damage and mix-ups. They are not a signature."),
    )
