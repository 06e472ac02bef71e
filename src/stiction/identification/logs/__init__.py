"""Logs in any supported kind of file, opened by `open_log`."""

from stiction.identification.logs.naming import parse_columns
from stiction.identification.logs.opening import join_logs, open_log, refuse_absent

__all__ = ["join_logs", "open_log", "parse_columns", "refuse_absent"]
