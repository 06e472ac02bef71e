"""Logs as people have them: any kind of file, through one door, `open_log`."""

from stiction.identification.logs.naming import parse_columns
from stiction.identification.logs.opening import join_logs, open_log

__all__ = ["join_logs", "open_log", "parse_columns"]
