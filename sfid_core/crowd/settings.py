"""How a crowd's answers are weighed: the methods by name, and their parameters."""

from dataclasses import dataclass
from enum import StrEnum

from sfid_core.learning.parameters import ParameterError


class CrowdMethod(StrEnum):
    """How the answers of a crowd become one."""

    MAJORITY = "majority"
    """A vote each."""
    WEIGHTED = "weighted"
    """A vote weighs what its worker's agreement with the winners has been."""
    ONE_COIN = "one-coin"
    """One accuracy a worker; a label weighs its log-odds (Dawid & Skene 1979 with one parameter)."""
    DAWID_SKENE = "dawid-skene"
    """One confusion matrix a worker (Dawid & Skene 1979)."""


def crowd_method(name: str) -> CrowdMethod:
    """Return the method of that name. Raises: ParameterError when there is none."""
    try:
        return CrowdMethod(name)
    except ValueError:
        known = ", ".join(CrowdMethod)
        message = f"crowd method {name!r} is unknown: choose one of {known}"
        raise ParameterError(message) from None


@dataclass(frozen=True, slots=True)
class CrowdSettings:
    """Parameters of an online aggregate; the defaults suit a live crowd of strangers.

    Raises: ParameterError when one is outside its range.
    """

    method: CrowdMethod = CrowdMethod.ONE_COIN
    abstain_below: float = 0.6
    """Nothing is said while the most probable action is less probable than this, 0 to 1."""
    prior_right: float = 4.0
    """Labels a newcomer is taken to have given right, 0.001 to 1000: the Beta prior."""
    prior_wrong: float = 2.0
    """Labels a newcomer is taken to have given wrong, 0.001 to 1000."""
    forgetting: float = 0.999
    """What earlier labels of a worker keep of their weight at each further one, 0.5 to 1; 1 is all."""
    influence_cap: float = 0.25
    """Share of a decision's weight that one worker may hold, 0.001 to 1; 1 is no cap."""
    spam_after: int = 20
    """Labels after which one who answers as chance would is called a spammer, 1 to 1,000,000."""
    gold_weight: float = 5.0
    """Ordinary labels that a label on a gold state counts for, 0.001 to 100."""
    diagonal_prior: float = 1.0
    """Dawid-Skene: labels a class that the prior of a worker's matrix is worth, 0.001 to 1000."""
    history_max: int = 50_000
    """Dawid-Skene: the latest labels that the matrices are estimated from, 100 to 10,000,000."""

    def __post_init__(self) -> None:
        crowd_method(self.method)
        for name, (low, high) in RANGES.items():
            value = getattr(self, name)
            if not low <= value <= high:
                usual = CrowdSettings.__dataclass_fields__[name].default
                message = f"{name} {value} is outside {low:,} to {high:,}: {usual} is usual"
                raise ParameterError(message)


RANGES: dict[str, tuple[float, float]] = {
    "abstain_below": (0, 1),
    "prior_right": (0.001, 1000),
    "prior_wrong": (0.001, 1000),
    "forgetting": (0.5, 1),
    "influence_cap": (0.001, 1),
    "spam_after": (1, 1_000_000),
    "gold_weight": (0.001, 100),
    "diagonal_prior": (0.001, 1000),
    "history_max": (100, 10_000_000),
}
"""Lowest and highest value of each parameter, both allowed."""
