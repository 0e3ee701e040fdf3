"""Every message on the wire, as frozen types with their limits.

Field names, units and the order of events are explained in README.md of this folder, for clients in any
language. Unknown fields are refused, so a typing error never passes as silence; a new field means a new
schema number.
"""

from typing import Annotated, Literal

from msgspec import Meta, Struct

from protocol.fields import (
    ACTION_NAME,
    NAME,
    ActionName,
    ActionNames,
    Asked,
    Check,
    CheckKey,
    Count,
    Finite,
    Id,
    MetActionName,
    MetName,
    Milliseconds,
    Name,
    Nanoseconds,
    OutcomeName,
    ParameterName,
    ParameterWord,
    Probability,
    Reward,
    Shard,
    Shards,
    StateKey,
    Text,
    Token,
    View,
    is_action_name,
    is_name,
)

Schema = Literal[1]
SCHEMA: Schema = 1


class Wire(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, gc=False):
    """What all messages share."""

    schema: Schema = SCHEMA


class WindowSpec(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The window for answers."""

    mode: Literal["early", "full", "until-answered"]
    span_ms: Annotated[int, Meta(ge=1, le=3_600_000)]
    quorum: Annotated[int, Meta(ge=0, le=1_000_000)] = 0


class MistakeMark(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A stretch of steps of the episode that went wrong, first to last."""

    first_step: Count
    last_step: Count


# ---------------------------------------------------------------- learner -> teachers


class Decision(Wire, frozen=True, kw_only=True, tag="decision"):
    """A decision as it stands; the last one by `sequence` is the truth."""

    session: Name
    epoch: Count
    sequence: Count
    decision: Count
    episode: Count
    step: Count
    phase: Literal["gathering", "beginning", "ready", "asking", "executing", "finished"]
    paused: bool
    asked: Asked
    state: StateKey
    view: View
    actions: ActionNames
    action: ActionName | None = None
    remaining_ms: Milliseconds | None = None
    window: WindowSpec
    teachers: Annotated[tuple[Name, ...], Meta(max_length=64)] = ()
    teachers_present: Count = 0
    method: Name
    episodes: Count
    optimal_steps: Count | None = None
    may_undo: bool = False
    """Whether an answer of the kind undo is welcome once the action was seen."""


class SaidBy(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One teacher's answer inside a learnt step."""

    teacher: Name
    kind: Asked | Literal["abstain"]
    action: ActionName | None = None
    reward: Reward | None = None


class Step(Wire, frozen=True, kw_only=True, tag="step"):
    """A learnt step: what was seen, said, done and learnt."""

    session: Name
    epoch: Count
    decision: Count
    episode: Count
    step: Count
    at_ns: Nanoseconds
    state: StateKey
    view: View
    action: ActionName
    said: Annotated[tuple[SaidBy, ...], Meta(max_length=256)] = ()
    label: ActionName | None = None
    h: Finite
    reward: Finite
    td_error: Finite
    td_error_shaped: Finite
    outcome: OutcomeName
    next_view: View
    values: Annotated[tuple[Finite, ...], Meta(max_length=64)]


class Episode(Wire, frozen=True, kw_only=True, tag="episode"):
    """A finished episode on the four measures."""

    session: Name
    epoch: Count
    decision: Count
    at_ns: Nanoseconds
    episode: Count
    steps: Count
    optimal_steps: Count | None = None
    abs_td_error: Finite
    abs_td_error_shaped: Finite
    discounted_return: Finite
    discounted_env_return: Finite
    inputs: Count
    agreements: Count
    outcome: OutcomeName


# ---------------------------------------------------------------- teachers -> learner, and its replies


class Join(Wire, frozen=True, kw_only=True, tag="join"):
    """A teacher asks to take part."""

    session: Name
    teacher: Name
    client: Text = ""
    token: Token | None = None


class Welcome(Wire, frozen=True, kw_only=True, tag="welcome"):
    """The teacher takes part: what they may do, and where the session stands."""

    session: Name
    epoch: Count
    rights: Annotated[tuple[Literal["answer", "window", "pause", "stop"], ...], Meta(max_length=8)]
    decision: Decision
    episodes: tuple[Episode, ...] = ()
    check_key: CheckKey | None = None
    """What the checks of this teacher's acknowledgements are keyed with: nobody else can make one."""


class Answer(Wire, frozen=True, kw_only=True, tag="answer"):
    """A teacher's answer to one decision; the id is made and stored by the teacher before it is sent."""

    answer_id: Id
    session: MetName
    teacher: MetName
    epoch: Count
    decision: Count
    episode: Count
    step: Count
    state: StateKey
    kind: Asked | Literal["abstain"]
    action: MetActionName | None = None
    reward: Reward | None = None
    guidance: Annotated[tuple[ActionName, ...], Meta(max_length=64)] = ()
    mistake: MistakeMark | None = None
    posterior: Annotated[dict[ActionName, Probability], Meta(max_length=64)] | None = None
    response_ms: Milliseconds | None = None
    token: Token | None = None

    def __post_init__(self) -> None:
        """Hold the names to their forms; a ValueError tells which has none."""
        action = self.action
        if not (is_name(self.session) and is_name(self.teacher)):
            wrong = "session" if is_name(self.teacher) else "teacher"
            raise ValueError(f"`{wrong}` is a name of the form {NAME}")
        if action is not None and not is_action_name(action):
            raise ValueError(f"`action` is the name of an action, of the form {ACTION_NAME}")


class Acknowledgement(Wire, frozen=True, kw_only=True, tag="acknowledgement"):
    """What became of an answer; sent only after the answer is durable."""

    answer_id: Id
    code: Literal["accepted", "superseded", "late", "rejected", "conflict"]
    reason: Text = ""
    check: Check
    epoch: Count
    journal_seq: Count


class Control(Wire, frozen=True, kw_only=True, tag="control"):
    """A teacher changes the window, pauses, resumes or stops the session."""

    session: Name
    teacher: Name
    verb: Literal["window", "pause", "resume", "stop"]
    window: WindowSpec | None = None
    token: Token | None = None


class Done(Wire, frozen=True, kw_only=True, tag="done"):
    """The request was carried out (or, `ok` false, was not: the reason says why)."""

    ok: bool
    reason: Text = ""


class Refusal(Wire, frozen=True, kw_only=True, tag="refusal"):
    """An error reply: the request could not be read, is not allowed, or cannot be served now."""

    code: Literal["malformed", "unknown-session", "denied", "busy", "not-durable", "conflict", "invalid"]
    reason: Text


# ---------------------------------------------------------------- sessions


class World(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="sokoban"):
    """The world of a session, as the environment needs it."""

    level: Annotated[str, Meta(max_length=16_384)]
    level_name: Text = "level"
    starts: Annotated[str, Meta(pattern=r"^([1-9][0-9]{0,6}|all|within:[1-9][0-9]{0,6})\Z")] = "4"
    goal_reward: Finite = 10.0
    step_reward: Finite = 0.0
    deadlock_reward: Finite = -10.0
    steps_max: Annotated[int, Meta(ge=1, le=1_000_000)] = 200


class GymWorld(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind", tag="gym"):
    """A Gymnasium environment with a finite number of actions, as the environment service makes it."""

    # No colon: a name with one would import any module that a stranger names.
    environment: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_./-]{0,127}\Z")]
    options: Annotated[
        dict[Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]{0,31}\Z")], bool | int | Finite | Text | None],
        Meta(max_length=32),
    ] = {}
    actions: ActionNames
    level_name: Text
    starts: Annotated[str, Meta(pattern=r"^([1-9][0-9]{0,6}|all)\Z")] = "4"
    render: Literal["text", "picture"] = "text"
    reward_scale: Finite = 1.0
    goal_reward: Finite | None = None
    step_reward: Finite = 0.0
    steps_max: Annotated[int, Meta(ge=1, le=1_000_000)] = 200


class CreateSession(Wire, frozen=True, kw_only=True, tag="create-session"):
    """Create a session; the same name with the same content again is the same session."""

    session: Name
    world: World | GymWorld
    method: Name = "sfid"
    parameters: Annotated[dict[ParameterName, Finite | ParameterWord], Meta(max_length=32)] = {}
    """Parameters of the method that differ from its defaults: numbers, or words of a choice."""
    episodes: Annotated[int, Meta(ge=1, le=1_000_000)] = 30
    seed: Count = 0
    window: WindowSpec
    teachers_min: Annotated[int, Meta(ge=0, le=1000)] = 1


class Branch(Wire, frozen=True, kw_only=True, tag="branch"):
    """Take a session up again from the beginning of an earlier episode, as a session of its own."""

    session: Name
    episode: Count
    branch: Name


class SessionQuery(Wire, frozen=True, kw_only=True, tag="session-query"):
    """Ask about one session, or about all of them."""

    session: Name | None = None
    first_episode: Count = 0
    """Where the episodes of a report begin; a report holds at most 100."""
    leave_out: Count = 0
    """Places of the list to leave out, from the latest: 0, or what a SessionList said in `older`."""


class LabelTotals(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What became of a session's answers; submitted = applied + superseded + late + rejected + pending."""

    submitted: Count
    acknowledged: Count
    applied: Count
    superseded: Count
    late: Count
    rejected: Count
    pending: Count


class SessionSummary(Wire, frozen=True, kw_only=True, tag="session-summary"):
    """One line about a session."""

    session: Name
    method: Name
    level_name: Text
    phase: Text
    paused: bool
    episode: Count
    episodes: Count
    decision: Count
    teachers: Annotated[tuple[Name, ...], Meta(max_length=64)]


class SessionList(Wire, frozen=True, kw_only=True, tag="session-list"):
    """Sessions of a learner, the latest last, as many as a message holds; older ones are on the next page."""

    sessions: tuple[SessionSummary, ...]
    older: Count | None = None
    """What to leave out for the next page; None where no older sessions are left."""
    shards: Shards = 1
    told: Annotated[tuple[Shard, ...], Meta(max_length=1_024)] = (0,)
    """Of these shards, those whose sessions this list tells of."""


class SessionReport(Wire, frozen=True, kw_only=True, tag="session-report"):
    """A session with its measures."""

    summary: SessionSummary
    config: CreateSession
    epoch: Count
    labels: LabelTotals
    teaching_ns: Nanoseconds
    q_sha256: Annotated[str, Meta(max_length=64)]
    malformed: dict[str, Count] = {}
    """Messages that could not be read, by sender."""
    failure: Text = ""
    """Why the session was stopped before its end, if it was."""
    first_episode: Count = 0
    episodes: tuple[Episode, ...]
    """At most 100, from `first_episode` on."""


class RowsQuery(Wire, frozen=True, kw_only=True, tag="rows-query"):
    """Ask for a session's journal from a row on: whoever comes late reads what happened before."""

    session: Name
    after_seq: Count = 0
    """The last row already read; 0 begins at the beginning."""


class JournalRow(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One row of a session's journal, as `protocol.journal` reads it."""

    seq: Count
    kind: Name
    at_ns: Nanoseconds
    body: bytes


class JournalRows(Wire, frozen=True, kw_only=True, tag="journal-rows"):
    """Rows of a session's journal in order; an erased row is left out."""

    session: Name
    rows: Annotated[tuple[JournalRow, ...], Meta(max_length=1024)] = ()
    after_seq: Count
    """The last row that this reply covers: what to ask for next."""
    whole: bool
    """Whether there was nothing after these rows."""
