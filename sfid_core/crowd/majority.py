"""Majority: a vote each."""

from sfid_core.crowd.em import vote_shares
from sfid_core.crowd.labels import LabelSet
from sfid_core.crowd.outcome import Outcome, agreement, winners


def majority(labels: LabelSet) -> Outcome:
    """Return the shares of the vote; a worker's reliability is the agreement with what won."""
    votes = labels.votes
    posterior = vote_shares(votes)
    return Outcome(posterior, *agreement(votes, winners(posterior)[votes.tasks, votes.labels]))
