"""Whether an answer says what its kind has to say: refused here, before it is stored and sent."""

from collections.abc import Sequence

from protocol.messages import Answer
from protocol.translate import check_posterior


def check_fits(message: Answer, actions: Sequence[str]) -> None:
    """Raise ValueError with the mend where an answer does not fit; `actions` are the decision's."""
    check_posterior(message)
    kind, choices = message.kind, ", ".join(actions)
    named = (
        *message.guidance,
        *(message.posterior or ()),
        *(() if message.action is None else (message.action,)),
    )
    unknown = [] if kind == "reward" else [name for name in named if name not in actions]
    if unknown:
        raise ValueError(f"action {unknown[0]!r} is not one of {choices}")
    if kind == "label" and message.action is None:
        raise ValueError(f"a label needs an action, one of {choices}")
    if kind == "reward" and (message.reward is None or not -1.0 <= message.reward <= 1.0):
        raise ValueError(f"reward = {message.reward}: give a number from -1 to 1")
    if kind == "guidance" and not message.guidance:
        raise ValueError(f"guidance names the actions worth considering, some of {choices}; or abstain")
    if kind == "mistake" and message.mistake is None:
        raise ValueError("a mark names its first and last step; or abstain")
    if kind == "nothing":
        raise ValueError("this decision asks for nothing: watch it, or abstain")
