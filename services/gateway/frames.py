"""What browser and gateway say to each other: JSON text frames, parsed once, within limits.

From the browser: hello, answer, submit, ping. To the browser: you, screen, link, decision, episodes, answer,
refused, pong. `page/wire.js` is the other end; both are of one version and served together.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from protocol.fields import ActionName, Asked, Count, Milliseconds, Name, Reward
from protocol.messages import Answer, Decision, Episode, MistakeMark
from services.screens import Screen, Value

VERSION = 1
EPISODES_SHOWN = 12
HexId = Annotated[str, Meta(pattern=r"^[0-9a-f]{32}\Z")]
HexState = Annotated[str, Meta(pattern=r"^([0-9a-f]{2}){0,32}\Z")]
Short = Annotated[str, Meta(max_length=256)]
Number = Annotated[int, Meta(ge=-(2**53), le=2**53)]
Filled = Annotated[str, Meta(max_length=2000)]


class Hello(Struct, frozen=True, forbid_unknown_fields=True, tag="hello"):
    """The first frame: who I am, by token, and how I came here."""

    version: Literal[1]
    token: Annotated[str, Meta(max_length=512)]
    nonce: Annotated[str, Meta(pattern=r"^[0-9a-f]{32}\Z")]
    arrival: Annotated[dict[Short, Short], Meta(max_length=24)] = {}


class Say(Struct, frozen=True, forbid_unknown_fields=True, tag="answer"):
    """An answer to a decision, stored by the browser before this was sent; who says it is in the token."""

    id: HexId
    session: Name
    epoch: Count
    decision: Count
    episode: Count
    step: Count
    state: HexState
    kind: Asked | Literal["abstain"]
    action: ActionName | None = None
    reward: Reward | None = None
    guidance: Annotated[tuple[ActionName, ...], Meta(max_length=8)] = ()
    mistake: MistakeMark | None = None
    response_ms: Milliseconds | None = None


class Submit(Struct, frozen=True, forbid_unknown_fields=True, tag="submit"):
    """A button of a screen was pressed."""

    screen: Name
    button: Name
    values: Annotated[dict[Name, bool | Number | float | Filled | None], Meta(max_length=64)] = {}


class Ping(Struct, frozen=True, forbid_unknown_fields=True, tag="ping"):
    """Is anybody there?"""


Frame = Hello | Say | Submit | Ping
_decoder = msgspec.json.Decoder(Frame)


class FrameError(ValueError):
    """A frame is not one of ours; nothing else escapes `read`."""


def read(text: str) -> Frame:
    """Return the frame in a text of at most some KiB. Raises FrameError, and nothing else."""
    try:
        frame: Frame = _decoder.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise FrameError(str(error)[:200]) from None
    return frame


def answer_of(say: Say, teacher: str, token: str) -> Answer:
    """Return the protocol's answer: the same bytes for the same frame."""
    return Answer(
        answer_id=bytes.fromhex(say.id),
        session=say.session,
        teacher=teacher,
        epoch=say.epoch,
        decision=say.decision,
        episode=say.episode,
        step=say.step,
        state=bytes.fromhex(say.state),
        kind=say.kind,
        action=say.action,
        reward=say.reward,
        guidance=say.guidance,
        mistake=say.mistake,
        response_ms=say.response_ms,
        token=token,
    )


# ---------------------------------------------------------------- to the browser


def written(kind: str, **fields: Any) -> str:  # noqa: ANN401 - any JSON value
    """Return a frame's text."""
    return msgspec.json.encode({"type": kind, **fields}).decode()


def decision_frame(decision: Decision, elapsed_ms: int) -> str:
    """Return a decision as it stands `elapsed_ms` after the learner said it; no names of other teachers."""
    remaining = decision.remaining_ms
    return written(
        "decision",
        session=decision.session,
        epoch=decision.epoch,
        sequence=decision.sequence,
        decision=decision.decision,
        episode=decision.episode,
        step=decision.step,
        phase=decision.phase,
        paused=decision.paused,
        asked=decision.asked,
        state=decision.state.hex(),
        view=decision.view,
        actions=decision.actions,
        action=decision.action,
        may_undo=decision.may_undo,
        remaining_ms=None if remaining is None else max(0, remaining - elapsed_ms),
        window={"mode": decision.window.mode, "span_ms": decision.window.span_ms},
        teachers=decision.teachers_present,
        episodes=decision.episodes,
        optimal_steps=decision.optimal_steps,
    )


def episodes_frame(episodes: list[Episode]) -> str:
    """Return the latest finished episodes, oldest first."""
    rows = [
        {"episode": one.episode, "steps": one.steps, "optimal": one.optimal_steps, "outcome": one.outcome}
        for one in episodes[-EPISODES_SHOWN:]
    ]
    return written("episodes", episodes=rows)


def screen_frame(screen: Screen) -> str:
    """Return a screen as the page draws it."""
    return written("screen", screen=msgspec.to_builtins(screen))


def checked_values(screen: Screen, button: str, values: Mapping[str, Value]) -> dict[str, Value] | None:
    """Return the values of a screen's fields, or None when the button or a value does not fit the screen."""
    pressed = next((one for one in screen.buttons if one.name == button), None)
    if pressed is None:
        return None
    if not pressed.fills:
        return {}
    if values.keys() - {field.name for field in screen.fields}:
        return None
    found = {field.name: values.get(field.name) for field in screen.fields}
    return found if all(_fits(field, found[field.name]) for field in screen.fields) else None


def _fits(field: Any, value: Value) -> bool:  # noqa: ANN401 - a Field; named so for its many kinds
    if value is None or value == "":
        return not field.required
    match field.kind.value:
        case "check":
            return isinstance(value, bool) and (value or not field.required)
        case "choice":
            return value in field.choices
        case "text":
            return isinstance(value, str) and len(value) <= field.length_max
        case _:
            number = isinstance(value, int | float) and not isinstance(value, bool)
            return number and field.low <= float(value) <= field.high
