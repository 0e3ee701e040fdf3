"""Majority and weighted majority, one decision after the other."""

from collections.abc import Sequence

from sfid_core.crowd.evidence import Vote, leaders, shares
from sfid_core.crowd.settings import CrowdSettings
from sfid_core.crowd.tally import Tallies


class MajorityOnline:
    """A vote each; a worker's reliability is the agreement with what won."""

    def __init__(self, actions: int, settings: CrowdSettings) -> None:
        self._actions = actions
        self._gold_weight = settings.gold_weight
        self._tallies = Tallies(actions, settings)
        self.workers = self._tallies.workers
        self.reliability = self._tallies.reliability

    def weight(self, worker: str) -> float:  # noqa: ARG002 - everybody's vote is worth the same
        """Return what the worker's vote weighs."""
        return 1.0

    def look(self, votes: Sequence[Vote]) -> tuple[list[float], list[float]]:
        """Return each action's share of the vote, and each vote's weight."""
        weights = [self.weight(worker) for worker, _ in votes]
        return shares(votes, weights, self._actions), weights

    def learn(self, votes: Sequence[Vote], acceptable: frozenset[int], gold: int | None) -> None:
        """Count who agreed with the winner; a tie teaches nothing but what gold or the solver says."""
        first = leaders(self.look(votes)[0])
        for worker, action in votes:
            if gold is not None:
                right = action == gold
                self._tallies.add(worker, self._gold_weight * right, self._gold_weight * (not right))
            elif action in acceptable:
                self._tallies.add(worker, 1.0, 0.0)
            elif len(first) == 1:
                right = action == first[0]
                self._tallies.add(worker, float(right), float(not right))


class WeightedOnline(MajorityOnline):
    """A vote weighs the worker's accuracy so far (WAWA: worker's agreement with the aggregate)."""

    def weight(self, worker: str) -> float:
        """Return what the worker's vote weighs."""
        return self._tallies.mean(worker)
