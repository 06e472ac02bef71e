"""The one family of errors that a user can act on."""


class StictionError(Exception):
    """A failure that the user can act on: what came, what was expected, what to do, in one line.

    The command line prints the message on standard error and exits with status 1, without a traceback. What a file
    put into the message (a name with line breaks, or with commands to the terminal) is shown escaped.
    """

    def __init__(self, message: str) -> None:
        """Keep the message to one printable line."""
        super().__init__("".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in message))


class LogError(StictionError):
    """A log that cannot be read, or that does not hold what was asked of it."""
