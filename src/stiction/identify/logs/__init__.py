"""Logs as people have them: any kind of file, through one door, `open_log`."""

from stiction.identify.logs.opening import open_log, parse_columns

__all__ = ["open_log", "parse_columns"]
