"""The one error that a user's input can cause."""


class BadInput(ValueError):
    """Input that cannot be used.

    The message is one line: what was got, and what is allowed. The command line prints it on standard error and
    exits with status 2.
    """
