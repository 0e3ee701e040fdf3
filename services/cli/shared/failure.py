"""How a command ends when it cannot do what was asked."""

OK = 0
NOT_SO = 1
"""The thing asked for is not so: a check failed, nothing was found, a service died."""
BAD_USAGE = 2
"""Bad usage, configuration or input."""


class CommandError(Exception):
    """One line for the person at the terminal: what is wrong, where, and the mend."""

    def __init__(self, message: str, exit_code: int = BAD_USAGE) -> None:
        super().__init__(message)
        self.exit_code = exit_code
