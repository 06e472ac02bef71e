"""Turns policy bundles under results/ into policy records, and lists every network that stands or stood there.

    python tools/policy_records.py        # writes results/policies.csv

A bundle becomes a record without its golden vectors, which are made again by the command of its row at its revision.
A policy whose folder was removed keeps its row, with `kept` false.
"""

from __future__ import annotations

import argparse
import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

from stiction.core.records import read_rows, write_rows
from stiction.files.bundle import CONTRACT, GOLDEN, POLICY, read_bundle

RESULTS = Path(__file__).parents[1] / "results"


@dataclass(frozen=True)
class PolicyRow:
    """One network of the results."""

    policy: str
    """Name of the policy."""
    folder: str
    """Folder under results/."""
    cohort: str
    """Folder under results/ of the experiment, whose policies are of one budget."""
    robot: str
    """Robot that it was trained for."""
    method: str
    """Training method."""
    seed: int
    """Seed of the training."""
    revision: str
    """Revision of the code that trained it."""
    command: str
    """Command of the training."""
    digest: str
    """SHA-256 of SHA256SUMS, the digest in summary.json."""
    network_sha256: str
    """SHA-256 of policy.onnx."""
    contract_sha256: str
    """SHA-256 of contract.json."""
    kept: bool
    """True if the network is there."""


def row_of(folder: Path, results: Path) -> PolicyRow:
    """Return the row of a policy record; raise `StictionError` where it is damaged."""
    bundle = read_bundle(folder, allow_record=True)
    path, contract = folder.relative_to(results), bundle.contract
    network, text = (hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in (POLICY, CONTRACT))
    return PolicyRow(
        policy=folder.name,
        folder=path.as_posix(),
        cohort=path.parent.as_posix().removesuffix("/policies"),
        robot=contract.robot,
        method=contract.method,
        seed=contract.seed,
        revision=contract.revision,
        command=contract.command,
        digest=bundle.digest,
        network_sha256=network,
        contract_sha256=text,
        kept=True,
    )


def policy_rows(results: Path) -> list[PolicyRow]:
    """Return the rows of the policies that stand, and of those that results/policies.csv lists and that are gone."""
    known = read_rows(results / "policies.csv", PolicyRow, optional=True)
    rows = {row.folder: replace(row, kept=False) for row in known}
    rows |= {row.folder: row for row in (row_of(path.parent, results) for path in results.rglob(POLICY))}
    return [rows[folder] for folder in sorted(rows)]


def main() -> None:
    """Read the folder, drop golden vectors, write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of results")
    results = parser.parse_args().results
    rows = policy_rows(results)
    for path in results.rglob(GOLDEN):
        path.unlink()
    write_rows(results / "policies.csv", rows)
    print(f"{results / 'policies.csv'}: {sum(row.kept for row in rows)} of {len(rows)} networks are there")


if __name__ == "__main__":
    main()
