"""`stiction study onset POLICY...`: from which friction on policies do not follow, and the number that tells."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

from stiction.core.flags import ARGUMENT
from stiction.core.records import read_rows, write_rows
from stiction_experiments.lab.study import Options, Report, Study, UsageError, Work

DESCRIPTION = """Walk policies under more and more joint friction until the worst of their fast commands falls
under 0.8, and show these onsets on twelve axes: friction over torque limit, over the gain kp, over what targets and
joints move, over the torque and the work of walking, over the robot's weight. The axis on which robots and gains lie
closest is the number that carries.

A policy takes a minute of one core. Policies of before that are in --out stay, and are not walked again: the
same command goes on, and more policies can be added.

Example:
  stiction study onset runs/exported/none-s10 runs/exported/none-s11 --out results/onset"""


@dataclass(frozen=True, kw_only=True)
class OnsetOptions(Options):
    """Options of `stiction study onset`."""

    policies: Annotated[tuple[Path, ...], ARGUMENT] = ()
    """Directories of policies, or names of shipped ones; none: the page is drawn anew from --out."""
    out: Path = Path("stiction-onset")
    """Directory for onsets.csv, reach.csv, onset.png, summary.json and report.html."""

    @property
    def free(self) -> tuple[str, ...]:
        """Options that add to the results of before."""
        return ("policies",)


def run(options: OnsetOptions, work: Work) -> Report:
    """Walk the policies that --out does not have, and judge all."""
    from stiction_experiments.onset.measure import OnsetRow, ReachRow, reaches_of, readings, walk_onset
    from stiction_experiments.onset.page import ordered, report

    onsets = read_rows(options.out / "onsets.csv", OnsetRow, optional=True)
    reaches = read_rows(options.out / "reach.csv", ReachRow, optional=True)
    if not options.policies and not onsets:
        raise UsageError("no policy given")
    bundles = work.bundles(options.policies) if options.policies else []
    work.begin()
    own = {row.policy: [each for each in reaches if each.policy == row.policy] for row in onsets}
    onsets = [replace(row, **readings(own[row.policy])) for row in onsets]
    known = {row.digest: own[row.policy] for row in onsets}
    for bundle in bundles:
        before = known.get(bundle.digest, [])
        if not before or not reaches_of(before).walked_enough:
            row, walked = walk_onset(bundle, before, work.threads, partial(work.progress, bundle.name))
            onsets = ordered([*(each for each in onsets if each.policy != row.policy), row])
            places = {each.policy: place for place, each in enumerate(onsets)}
            reaches = [*(each for each in reaches if each.policy != row.policy), *walked]
            reaches.sort(key=lambda each: places[each.policy])
            # A stop loses the policy that walks.
            write_rows(options.out / "onsets.csv", onsets)
            write_rows(options.out / "reach.csv", reaches)
    made_by = {name: work.provenance[name] for name in ("command", "revision")}
    return report(onsets, reaches, {"seconds": work.seconds}, made_by)


STUDY = Study(
    "which number says how much friction is too much, on other robots and with other gains",
    DESCRIPTION,
    OnsetOptions,
    run,
    results=("onsets.csv", "reach.csv", "evidence.json", "onset.png"),
)
