"""The switch: methods by name."""

from sfid_core.learning.method import Method, ParameterError, Parameters
from sfid_core.learning.q_learner import QLearner
from sfid_core.learning.reward import RewardShaping
from sfid_core.learning.sfid import SfID

METHODS: dict[str, type[QLearner]] = {"sfid": SfID, "reward": RewardShaping, "q-learning": QLearner}


def make_method(name: str, actions: int, parameters: Parameters, seed: int, session: str) -> Method:
    """Return the named method with an empty table.

    Args: actions: number of actions; seed, session: name the stream of its draws.
    Raises: ParameterError for a name that is not a method.
    """
    if name not in METHODS:
        message = f"unknown method {name!r}: choose one of {', '.join(METHODS)}"
        raise ParameterError(message)
    return METHODS[name](actions, parameters, seed, session)
