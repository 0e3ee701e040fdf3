"""The one error of experiments."""


class ExperimentError(ValueError):
    """Settings or results do not allow what is asked; the text is one line: what is wrong, and the mend."""
