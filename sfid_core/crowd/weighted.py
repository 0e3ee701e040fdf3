"""Weighted majority: a vote weighs what its worker's agreement with the majority is (WAWA)."""

from sfid_core.crowd.em import vote_shares
from sfid_core.crowd.labels import LabelSet
from sfid_core.crowd.majority import majority
from sfid_core.crowd.outcome import Outcome


def weighted_majority(labels: LabelSet) -> Outcome:
    """Return the shares of the vote by weight, once: the reliabilities are those of the plain majority."""
    _, reliability, error = majority(labels)
    votes = labels.votes
    return Outcome(vote_shares(votes, reliability[votes.workers]), reliability, error)
