"""One accuracy a worker, learnt one decision after the other from what the crowd came to."""

from collections.abc import Sequence
from math import log

from sfid_core.crowd.evidence import Vote, influence_limit, softmax
from sfid_core.crowd.settings import CrowdSettings
from sfid_core.crowd.tally import Tallies


class OneCoinOnline:
    """An action's log-odds are the sum of its labels' weights; each label is then judged by the posterior.

    The prior's mean lies above chance, which decides between the labelling and its mirror image: a crowd is
    taken to be honest until gold states say otherwise.
    """

    def __init__(self, actions: int, settings: CrowdSettings) -> None:
        self._actions = actions
        self._settings = settings
        self._tallies = Tallies(actions, settings)
        self.workers = self._tallies.workers
        self.reliability = self._tallies.reliability
        odds = settings.prior_right / settings.prior_wrong * (actions - 1)
        self._newcomer = max(log(odds), 0.0)

    def look(self, votes: Sequence[Vote]) -> tuple[list[float], list[float]]:
        """Return the posterior over the actions, and what each label added to its action's log-odds."""
        weights = [self._tallies.log_odds(worker) for worker, _ in votes]
        if self._settings.influence_cap < 1:
            limit = influence_limit(weights, self._newcomer, self._settings.influence_cap)
            weights = [min(max(weight, -limit), limit) for weight in weights]
        scores = [0.0] * self._actions
        for (_, action), weight in zip(votes, weights, strict=True):
            scores[action] += weight
        return softmax(scores), weights

    def learn(self, votes: Sequence[Vote], acceptable: frozenset[int], gold: int | None) -> None:
        """Judge each label: by gold, as right where the solver accepts it, else by the posterior."""
        if gold is not None:
            heavy = self._settings.gold_weight
            for worker, action in votes:
                self._tallies.add(worker, heavy * (action == gold), heavy * (action != gold))
            return
        posterior, _ = self.look(votes)
        for worker, action in votes:
            right = 1.0 if action in acceptable else posterior[action]
            self._tallies.add(worker, right, 1.0 - right)
