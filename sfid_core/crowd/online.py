"""A live crowd's answers become one: conclude a decision, then learn from it who is to be believed.

The aggregate is a fold: the same calls in the same order give the same bits, so a journal of them rebuilds
it, and leaving out one worker's labels forgets the worker.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

from sfid_core.crowd.evidence import Vote, decide
from sfid_core.crowd.online_dawid_skene import DawidSkeneOnline
from sfid_core.crowd.online_majority import MajorityOnline, WeightedOnline
from sfid_core.crowd.online_one_coin import OneCoinOnline
from sfid_core.crowd.settings import CrowdMethod, CrowdSettings, crowd_method
from sfid_core.crowd.tally import Reliability, Standing
from sfid_core.learning.parameters import ParameterError

__all__ = ["Conclusion", "CrowdMethod", "CrowdSettings", "OnlineAggregate", "Reliability", "Standing"]

ACTIONS_MAX = 1000


class Conclusion(NamedTuple):
    """What a crowd's answers to one decision come to."""

    posterior: tuple[float, ...]
    """Probability of each action being right (majority, weighted: its share of the vote); sums to 1."""
    action: int | None
    """The most probable action; None for an abstention: no label, a tie, or below the threshold."""
    weights: dict[str, float]
    """What each worker's label weighed: votes, or log-odds (below 0: it counted against its action)."""


class OnlineMethod(Protocol):
    """A method behind the switch; votes come sorted by worker, at least one."""

    def look(self, votes: Sequence[Vote]) -> tuple[list[float], list[float]]:
        """Return posterior and weights, changing nothing."""

    def learn(self, votes: Sequence[Vote], acceptable: frozenset[int], gold: int | None) -> None:
        """Update what is known of the workers."""

    def reliability(self, worker: str) -> Reliability:
        """Return what is known of a worker, of a stranger what the prior says."""

    def workers(self) -> tuple[str, ...]:
        """Return everyone something was learnt of, sorted."""


METHODS: dict[CrowdMethod, type[MajorityOnline | OneCoinOnline | DawidSkeneOnline]] = {
    CrowdMethod.MAJORITY: MajorityOnline,
    CrowdMethod.WEIGHTED: WeightedOnline,
    CrowdMethod.ONE_COIN: OneCoinOnline,
    CrowdMethod.DAWID_SKENE: DawidSkeneOnline,
}


class OnlineAggregate:
    """Weigh the labels of a crowd, decision by decision.

    Args: actions: number of actions K, 2 to 1000; settings: method and parameters.
    Raises: ParameterError for a number of actions outside its range.
    """

    def __init__(self, actions: int, settings: CrowdSettings) -> None:
        if not 2 <= actions <= ACTIONS_MAX:
            message = f"actions {actions} is outside [2, {ACTIONS_MAX}]: a crowd chooses between two or more"
            raise ParameterError(message)
        self._actions = actions
        self._settings = settings
        self._method: OnlineMethod = METHODS[crowd_method(settings.method)](actions, settings)

    def conclude(self, labels: Mapping[str, int | None]) -> Conclusion:
        """Return what these labels come to, changing nothing.

        Args: labels: action index by worker's name; None is an explicit abstention, and weighs nothing.
        Raises: ParameterError for an action outside [0, actions).
        """
        votes = self._votes(labels)
        if not votes:
            return Conclusion((1.0 / self._actions,) * self._actions, None, {})
        posterior, weights = self._method.look(votes)
        by_name = {worker: weight for (worker, _), weight in zip(votes, weights, strict=True)}
        return Conclusion(tuple(posterior), decide(posterior, self._settings.abstain_below), by_name)

    def learn(
        self,
        labels: Mapping[str, int | None],
        acceptable: frozenset[int] | None = None,
        gold: int | None = None,
    ) -> None:
        """Update the workers' reliability, once, after the decision has closed.

        Gold judges: every label counts as right or wrong by it, with the weight of several. `acceptable`
        excuses: naming any of these actions counts as right, and the other labels are judged by what the
        crowd came to. Without either, a label that stands alone teaches nothing: it would only agree with
        itself.

        Args: labels: as for `conclude`; acceptable: the optimal actions, where the solver knows them; gold:
            the one optimal action of a gold state.
        Raises: ParameterError for an action outside [0, actions), and for gold beside another optimum.
        """
        votes = self._votes(labels)
        excused = acceptable or frozenset()
        for action in sorted(excused if gold is None else excused | {gold}):
            self._check(action, "the solver")
        if gold is not None and excused - {gold}:
            message = (
                f"gold {gold} stands beside acceptable {sorted(excused)}: a gold state has one optimal action"
            )
            raise ParameterError(message)
        told = gold is not None or any(action in excused for _, action in votes)
        if len(votes) > 1 or (votes and told):
            self._method.learn(votes, excused, gold)

    def reliability(self, worker: str) -> Reliability:
        """Return the worker's estimated accuracy with its error; of a stranger, what the prior says."""
        return self._method.reliability(worker)

    def workers(self) -> tuple[str, ...]:
        """Return the names of all workers something was learnt of, sorted."""
        return self._method.workers()

    def _votes(self, labels: Mapping[str, int | None]) -> list[Vote]:
        votes = [(worker, labels[worker]) for worker in sorted(labels)]
        named = [(worker, action) for worker, action in votes if action is not None]
        for worker, action in named:
            self._check(action, f"worker {worker!r}")
        return named

    def _check(self, action: int, who: str) -> None:
        if not 0 <= action < self._actions:
            message = (
                f"action {action} of {who} is outside [0, {self._actions}): name one of the world's actions"
            )
            raise ParameterError(message)
