"""Remedies other than a training: feed friction forward, raise the gain, repair the joint."""

from __future__ import annotations

from statistics import median

from stiction.core.records import two_digits
from stiction.files.advice import robot_title
from stiction.files.onset import GAINS_ALIKE, OnsetEvidence, shipped_onsets

FORWARD = (
    "Feed it forward: `stiction deploy BUNDLE --forward joints.json`. On virtual robots, with the friction of their "
    "own benches, five of five policies that never met friction follow straight walks so at 10 %, and three at 20 %, "
    "without it two and none; with half of the true friction fed they no longer did at 20 %, and with half too much "
    "some joints hunt (`results/compensation`). It depends on the policy: try it on yours"
)
"""Advice on compensation, the first way without a training; a test holds its source."""

GAIN = "@kp="
"""Part of a condition's name between its robot and the factor of its gain."""


def gain_text(limit: float | None, kp: float | None, evidence: OnsetEvidence | None = None) -> str:
    """Return what another gain would change, by the robot that walked with several; empty where none did.

    limit: torque limit [N m]; kp: gain [N m/rad], None or 0 where unknown; evidence: by default the shipped one.
    """
    conditions = (evidence or shipped_onsets()).conditions
    base = next((one.robot.partition(GAIN)[0] for one in conditions if GAIN in one.robot), None)
    gains = [one for one in conditions if base and (one.robot == base or one.robot.startswith(base + GAIN))]
    if base is None or len(gains) < 2:
        return ""
    gains.sort(key=lambda one: one.softness, reverse=True)
    best = max(gains, key=lambda one: one.on("torque_limit")).softness
    softness = _listed([one.softness for one in gains])
    onsets, still = (
        _listed([100 * one.on("torque_limit", reading) for one in gains]) for reading in ("onsets", "standstill")
    )
    seen = (
        f"{robot_title(base)}, trained with τ_max/kp of {softness} rad, lost a fifth of some command's speed at "
        f"{onsets} % of the torque limit and half of all at {still} %; its joints jitter "
        f"{_listed([median(one.jitter) for one in gains])} rad/s². No other robot was tried"
    )
    if not limit or not kp:
        return f"Raise kp: a training with soft joints may gain by it, one with stiff joints does not. {seen}."
    if limit / kp <= GAINS_ALIKE * best:
        return f"Raising kp is not advised, τ_max/kp is {two_digits(limit / kp)} rad: {seen}."
    return f"Raise kp to {two_digits(limit / best)} N m/rad, and train with it: {seen}."


def other_ways(limit: float | None, kp: float | None) -> str:
    """Return the remedies; limit: torque limit [N m]; kp: gain [N m/rad]; None where unknown."""
    return f"Beside a training: {FORWARD}. {gain_text(limit, kp)} Repair the joint: it needs none of these then."


def _listed(values: list[float]) -> str:
    """Return numbers as `0.63, 0.32 and 0.16`."""
    *first, last = map(two_digits, values)
    return f"{', '.join(first)} and {last}"
