"""Write a lock file from one with hashes: pip's form, and with the hashes that only the lock of before knows.

    python tools/lock.py NEW LOCK

torch's CPU builds are on an index of their own: their hashes are added by hand, and stay while the version does.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

MORE = ("torch",)
"""Packages whose further hashes stay."""


def entries(text: str) -> dict[str, list[str]]:
    """Return requirement -> its hashes, of a lock file."""
    lines = text.replace(" \\\n", " ").splitlines()
    parts = [re.split(r"\s+--hash=", line) for line in lines if line.strip()]
    return {head.replace(" ;", ";").strip(): [one.strip() for one in hashes] for head, *hashes in parts}


def main() -> None:
    """Merge and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("new", type=Path, help="the lock with hashes, as uv wrote it")
    parser.add_argument("lock", type=Path, help="the lock of before, which is written over")
    asked = parser.parse_args()
    after, before = entries(asked.new.read_text()), entries(asked.lock.read_text())
    for head, hashes in after.items():
        if head.partition("==")[0] in MORE:
            hashes += [one for one in before.get(head, []) if one not in hashes]
    asked.lock.write_text("".join(" \\\n    --hash=".join([head, *hashes]) + "\n" for head, hashes in after.items()))


if __name__ == "__main__":
    main()
