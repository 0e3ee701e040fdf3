"""How a crowd's answers are weighed: the methods by name, and their parameters."""

from dataclasses import dataclass
from enum import StrEnum

from sfid_core.learning.method import ParameterError


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
    """Nothing is said while the most probable action is less probable than this, in [0, 1]."""
    prior_right: float = 4.0
    """Labels a newcomer is taken to have given right, in (0, 1000]; with `prior_wrong` the Beta prior."""
    prior_wrong: float = 2.0
    """Labels a newcomer is taken to have given wrong, in (0, 1000]."""
    forgetting: float = 0.999
    """What a worker's earlier labels keep of their weight at each further one, in [0.5, 1]; 1 forgets nothing."""
    influence_cap: float = 0.25
    """Share of a decision's weight that one worker may hold, in (0, 1]; 1 is no cap."""
    spam_after: int = 20
    """Labels after which one who answers as chance would is called a spammer, 1 to 1,000,000."""
    gold_weight: float = 3.0
    """Ordinary labels that a label on a gold state counts for, in (0, 100]."""
    diagonal_prior: float = 1.0
    """Dawid-Skene: what a newcomer's matrix weighs in labels a class, in (0, 1000]."""
    history_max: int = 50_000
    """Dawid-Skene: the latest labels that the matrices are estimated from, 100 to 10,000,000."""

    def __post_init__(self) -> None:
        self._check("abstain_below", 0 <= self.abstain_below <= 1, "[0, 1]", 0.6)
        self._check("prior_right", 0 < self.prior_right <= 1000, "(0, 1000]", 4.0)
        self._check("prior_wrong", 0 < self.prior_wrong <= 1000, "(0, 1000]", 2.0)
        self._check("forgetting", 0.5 <= self.forgetting <= 1, "[0.5, 1]", 0.999)
        self._check("influence_cap", 0 < self.influence_cap <= 1, "(0, 1]", 0.25)
        self._check("spam_after", 1 <= self.spam_after <= 1_000_000, "[1, 1000000]", 20)
        self._check("gold_weight", 0 < self.gold_weight <= 100, "(0, 100]", 3.0)
        self._check("diagonal_prior", 0 < self.diagonal_prior <= 1000, "(0, 1000]", 1.0)
        self._check("history_max", 100 <= self.history_max <= 10_000_000, "[100, 10000000]", 50_000)

    def _check(self, name: str, holds: bool, allowed: str, usual: float) -> None:  # noqa: FBT001 - a comparison
        if not holds:
            message = f"{name} {getattr(self, name)} is outside {allowed}: {usual} is usual"
            raise ParameterError(message)
