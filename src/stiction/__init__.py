"""Dry friction in robot joints: from a log, through training and proof of transfer, to the robot."""

from importlib.metadata import version

__version__ = version("stiction")
