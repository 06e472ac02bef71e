"""Training methods of other papers, and of the paper's failures: entry points of `stiction.methods`."""

CODE = "stiction_experiments:methods/*.py"
"""Pattern of the files of the methods, for `stiction.core.provenance.source_digest`."""
