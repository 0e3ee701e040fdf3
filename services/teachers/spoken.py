"""What the keys of the terminal teacher say: which answer a key is to what is asked."""

from typing import Literal, NamedTuple

from protocol.fields import Asked
from protocol.messages import Decision, MistakeMark
from services.teachers.panel import ARROWS

DIRECTIONS = {
    "left": "LEFT", "h": "LEFT", "a": "LEFT",
    "down": "DOWN", "j": "DOWN", "s": "DOWN",
    "up": "UP", "k": "UP", "w": "UP",
    "right": "RIGHT", "l": "RIGHT", "d": "RIGHT",
}  # fmt: skip
REWARDS = {"plus": 1.0, "equals_sign": 1.0, "p": 1.0, "minus": -1.0, "b": -1.0}
NUMBERS = {str(number): number - 1 for number in range(1, 10)}
"""Keys of actions by their place in the decision's list, for worlds with others than the four ways."""
ABSTAIN, UNDO = "space", "u"
ANSWERING = {
    **{key: f"action {key}" for key in NUMBERS},
    **{key: f"{ARROWS[action]} {action}" for key, action in DIRECTIONS.items()},
    **{key: "praise" if reward > 0 else "blame" for key, reward in REWARDS.items()},
    ABSTAIN: "nothing to say",
    UNDO: "take it back",
}
"""Keys that answer, and their words."""
ASKED = {
    "label": "the way you would go",
    "reward": "praise or blame",
    "guidance": "a way worth trying",
    "mistake": "what the agent should have done",
}
"""What is asked, in words."""

HELP = """\
You watch an agent learn. It decides by itself, and learns from what you say.

 arrows, h j k l, w a s d   the way you would go now (where ways are asked),
                            or should have been gone (where mistakes are)
 + = p                      praise the move you saw (where praise is asked)
 - b                        blame it
 u                          take it back (where that can be done)
 1 2 3 ...                  an action by its number, where there are others than ways
 space                      nothing to say this time

 m                          window: early, full, until-answered
 , .                        window shorter, longer by 0.25 s
 z                          pause, and go on
 q                          leave; what you said is saved

A key counts once, for the decision on screen when you pressed it.
A held key counts once; a key pressed while nothing is asked does not.

 @@ agent   [] box   () goal   {} box on goal   (@ agent on goal

Any key closes this page."""


class Spoken(NamedTuple):
    """An answer as a key says it."""

    text: str
    kind: Asked | Literal["abstain"]
    action: str | None = None
    reward: float | None = None
    guidance: tuple[str, ...] = ()
    mistake: MistakeMark | None = None


def action_of(decision: Decision, key: str) -> str | None:
    """Return the action of the decision that a key names, by direction or number; None without one."""
    if key in NUMBERS:
        return decision.actions[NUMBERS[key]] if NUMBERS[key] < len(decision.actions) else None
    action = DIRECTIONS.get(key)
    return action if action in decision.actions else None


def spoken(decision: Decision, key: str) -> Spoken | None:
    """Return what a key of `ANSWERING` says to a decision; None where it answers nothing that is asked."""
    text, asked = ANSWERING[key], decision.asked
    action, reward = action_of(decision, key), REWARDS.get(key)
    if key in NUMBERS:
        text = action or text
    if key == ABSTAIN:
        return Spoken(text, "abstain")
    if action is not None and asked == "label":
        return Spoken(text, asked, action=action)
    if action is not None and asked == "guidance":
        return Spoken(text, asked, guidance=(action,))
    if action is not None and asked == "mistake":
        step = MistakeMark(first_step=decision.step, last_step=decision.step)
        return Spoken(f"should have gone {text}", asked, action=action, mistake=step)
    if reward is not None and asked == "reward":
        return Spoken(text, asked, reward=reward)
    if key == UNDO and asked == "reward" and decision.may_undo:
        return Spoken(text, "undo")
    return None
