"""What learner and environment say to each other; see messages.py for what all messages share."""

from typing import Annotated

from msgspec import Meta

from protocol.fields import ActionName, ActionNames, Count, Finite, Name, OutcomeName, StateKey, View
from protocol.messages import GymWorld, Wire, World

UNDO = "UNDO"
"""In place of an action's name: the environment takes the last step back."""


class Begin(Wire, frozen=True, kw_only=True, tag="begin"):
    """Begin an episode; `actions` already taken are executed again (a restored environment)."""

    session: Name
    epoch: Count
    episode: Count
    seed: Count
    world: World | GymWorld
    actions: Annotated[tuple[ActionName, ...], Meta(max_length=1_000_000)] = ()


class Begun(Wire, frozen=True, kw_only=True, tag="begun"):
    """The environment stands where the learner asked it to."""

    episode: Count
    step: Count
    state: StateKey
    view: View
    optimal_steps: Count | None = None
    actions: ActionNames


class ExecuteAction(Wire, frozen=True, kw_only=True, tag="execute"):
    """Execute an action, exactly once by decision: a repeat is answered with the same result."""

    session: Name
    epoch: Count
    decision: Count
    episode: Count
    step: Count
    state: StateKey
    action: ActionName


class Executed(Wire, frozen=True, kw_only=True, tag="executed"):
    """The action was executed."""

    decision: Count
    reward: Finite
    outcome: OutcomeName
    state: StateKey
    view: View
    optimal_steps: Count | None = None
    """Fewest steps from the new state; null where there is no way or nobody knows."""
