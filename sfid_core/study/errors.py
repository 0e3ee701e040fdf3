"""What can be wrong with a study; each text is one line: what is wrong, where, and the mend."""


class StudyError(ValueError):
    """A study's definition makes no sense."""


class NotNow(Exception):  # noqa: N818 - not a fault of the program
    """What a participant did does not fit the step that they are at; nothing has changed."""
