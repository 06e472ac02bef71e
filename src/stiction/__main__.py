"""`python -m stiction` is the command line."""

from stiction.cli.main import entry

entry()
