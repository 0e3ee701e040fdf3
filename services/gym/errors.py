"""The one error of this package."""


class GymError(ValueError):
    """An environment cannot be a session's world; one line with the mend."""
