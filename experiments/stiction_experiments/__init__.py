"""The experiments behind the results of stiction, a folder each; `lab` is what they share."""

from pathlib import Path

PACKAGE = Path(__file__).resolve().parent
"""The folder of the package."""

CODE = ("**/*.py", "stiction_experiments:**/*.py")
"""All code, as patterns of `source_files`."""
