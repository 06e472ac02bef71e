"""The one family of errors that a user can act on."""


class StictionError(Exception):
    """A failure that the user can act on: what came, what was expected, what to do, in one line.

    The command line prints the message on standard error and exits with status 1, without a traceback.
    """


class LogError(StictionError):
    """A log that cannot be read, or that does not hold what was asked of it."""
