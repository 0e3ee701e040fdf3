"""One session as tidy tables: its answers, steps, episodes, states, and who was there when."""

from datetime import UTC, datetime
from typing import Any

from services.exports.columns import EPISODE, METHOD
from services.exports.session_story import AnswerRow, StepRow, Story
from services.exports.table import Column, Kind, Table

_SESSION = Column("session", Kind.TEXT, "Name of the session.")
_AT = Column("at", Kind.TEXT, "When it was journaled: ISO 8601, UTC, microseconds, by the learner's clock.")
_AT_S = Column("at_s", Kind.NUMBER, "Since the session was created.", "s")
_TEACHER = Column("teacher", Kind.TEXT, "Pseudonym; erased-N stands for somebody who was forgotten.")
_DECISION = Column("decision", Kind.WHOLE, "Number of the decision over the whole session, from 0.")
_STEP = Column("step", Kind.WHOLE, "Step within the episode, from 0.")
_STATE = Column("state", Kind.TEXT, "Key of the state in hex; the table states draws it.")
_OUTCOME = Column(
    "outcome",
    Kind.TEXT,
    "running, solved, deadlock, failed (the world ended it without success) or cap (cut off).",
)
_SHA256 = Column("q_sha256", Kind.TEXT, "SHA-256 of what had been learnt, in hex.")


def session_tables(story: Story) -> tuple[Table, ...]:
    """Return all tables of a session; their rows are in the order of the journal. Raises: ExportError."""
    return (
        _session(story),
        _answers(story),
        _steps(story),
        _episodes(story),
        _states(story),
        _presence(story),
    )


def iso(at_ns: int) -> str:
    """Return nanoseconds since 1970 as ISO 8601 in UTC with microseconds, which R and pandas both read."""
    seconds, ns = divmod(at_ns, 1_000_000_000)
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}.{ns // 1_000:06d}Z"


def _when(story: Story, at_ns: int) -> tuple[str, float]:
    return iso(at_ns), round((at_ns - story.created_ns) / 1e9, 6)


def _session(story: Story) -> Table:
    config, counts = story.config, story.session.counts
    columns = (
        _SESSION,
        Column("created", Kind.TEXT, "When it was created: ISO 8601, UTC."),
        Column("world", Kind.TEXT, "Name of the level or environment."),
        Column("actions", Kind.TEXT, "Names of the actions by index, parted by spaces."),
        METHOD,
        Column("parameters", Kind.TEXT, "What differs from the method's defaults: NAME=VALUE, by spaces."),
        Column("seed", Kind.WHOLE, "Seed of every draw."),
        Column("window", Kind.TEXT, "When the first window closed: early, full or until-answered."),
        Column("window_ms", Kind.WHOLE, "Its span.", "ms"),
        Column("episodes_planned", Kind.WHOLE, "Episodes that were asked for.", "episodes"),
        Column("episodes_done", Kind.WHOLE, "Episodes that were finished.", "episodes"),
        Column("submitted", Kind.WHOLE, "Answers that came, abstentions apart.", "answers"),
        Column("applied", Kind.WHOLE, "Of these, learnt from.", "answers"),
        Column("superseded", Kind.WHOLE, "Of these, after the close, or replaced by a later one.", "answers"),
        Column("late", Kind.WHOLE, "Of these, after the deadline.", "answers"),
        Column("rejected", Kind.WHOLE, "Of these, answers to what was not asked.", "answers"),
        Column("pending", Kind.WHOLE, "Of these, waiting for their step at the end.", "answers"),
        Column("erased_rows", Kind.WHOLE, "Rows of the journal whose content was erased.", "rows"),
        Column("teaching_s", Kind.NUMBER, "From the opening of decisions to their update, summed.", "s"),
        _SHA256,
    )
    parameters = " ".join(f"{name}={value}" for name, value in sorted(config.parameters.items()))
    row = (
        *(config.session, iso(story.created_ns), config.world.level_name, " ".join(story.actions)),
        *(config.method, parameters, config.seed, config.window.mode, config.window.span_ms),
        *(config.episodes, len(story.episodes)),
        *(counts.submitted, counts.applied, counts.superseded, counts.late, counts.rejected, counts.pending),
        *(story.erased, story.session.teaching_ns / 1e9, story.session.learner.sha256()),
    )
    return Table.of_rows("session", "The one row is the session.", columns, [row])


def _answers(story: Story) -> Table:
    columns = (
        _SESSION,
        Column("seq", Kind.WHOLE, "Number of its row in the learner's journal."),
        _AT,
        _AT_S,
        _TEACHER,
        Column("answer_id", Kind.TEXT, "The id that its teacher made, in hex."),
        _DECISION,
        EPISODE,
        _STEP,
        _STATE,
        Column("kind", Kind.TEXT, "label, reward, guidance, undo, mistake or abstain."),
        Column("action", Kind.TEXT, "The action that was named."),
        Column("reward", Kind.NUMBER, "Praise or blame, from -1 to 1."),
        Column("guidance", Kind.TEXT, "The actions worth considering, parted by spaces."),
        Column("first_step", Kind.WHOLE, "First step of the marked mistake."),
        Column("last_step", Kind.WHOLE, "Last step of the marked mistake."),
        Column("code", Kind.TEXT, "What the teacher was told: accepted, superseded, late or rejected."),
        Column("reason", Kind.TEXT, "Why, where it was rejected."),
        Column("applied", Kind.TRUTH, "Whether it was learnt from."),
        Column("response_ms", Kind.NUMBER, "From showing to answering, by the teacher's own clock.", "ms"),
        Column(
            "latency_ms",
            Kind.NUMBER,
            "From the opening of its window to its arrival, by the learner's clock; missing after it closed.",
            "ms",
        ),
    )
    rows = [_answer(story, row) for row in story.answers]
    return Table.of_rows("answers", "Each row is one answer of one teacher, as it came.", columns, rows)


def _answer(story: Story, row: AnswerRow) -> tuple[Any, ...]:
    message = row.message
    mark = message.mistake
    return (
        *(story.config.session, row.seq, *_when(story, row.at_ns), message.teacher, message.answer_id.hex()),
        *(message.decision, message.episode, message.step, message.state.hex()),
        *(message.kind, message.action, message.reward, " ".join(message.guidance) or None),
        *((None, None) if mark is None else (mark.first_step, mark.last_step)),
        *(row.code, row.reason or None, row.applied, message.response_ms, row.latency_ms),
    )


def _steps(story: Story) -> Table:
    columns = (
        *(_SESSION, _AT, _AT_S, _DECISION, EPISODE, _STEP, _STATE),
        Column("action", Kind.TEXT, "What the agent did; UNDO takes the step before back."),
        Column("label", Kind.TEXT, "The action that teachers named, merged; missing for silence."),
        Column("agreed", Kind.TRUTH, "Whether that is what the agent did; missing without a label."),
        Column("answers", Kind.WHOLE, "Answers that counted, abstentions included.", "answers"),
        Column("h", Kind.NUMBER, "The teachers' part of the reward; 0 is silence.", "reward"),
        Column("reward", Kind.NUMBER, "The environment's reward.", "reward"),
        Column("td_error", Kind.NUMBER, "Temporal-difference error without h (paper, Eq. 2).", "reward"),
        Column("td_error_shaped", Kind.NUMBER, "Temporal-difference error with h (Eq. 4).", "reward"),
        _OUTCOME,
        Column("next_state", Kind.TEXT, "Key of the state after the action, in hex."),
        *(
            Column(f"q_{name.lower()}", Kind.NUMBER, f"Q of {name} in the state, after the update.", "reward")
            for name in story.actions
        ),
    )
    return Table.of_rows(
        "steps", "Each row is one executed step.", columns, [_step(story, row) for row in story.steps]
    )


def _step(story: Story, row: StepRow) -> tuple[Any, ...]:
    one = row.measures
    label = None if one.label is None else story.actions[one.label]
    return (
        *(story.config.session, *_when(story, row.at_ns), one.decision, one.episode, one.step),
        *(one.state.hex(), row.action, label, None if label is None else label == row.action),
        *(len(one.answers), one.learned.h, one.reward, one.learned.environment, one.learned.shaped),
        *(one.outcome.value, row.next_state.hex(), *one.values),
    )


def _episodes(story: Story) -> Table:
    columns = (
        *(_SESSION, _AT, _AT_S, EPISODE),
        Column("steps", Kind.WHOLE, "Actions executed in it.", "steps"),
        Column("optimal_steps", Kind.WHOLE, "Fewest steps from its start; missing where unknown.", "steps"),
        Column("abs_td_error", Kind.NUMBER, "Mean of |td_error| over its learnt steps.", "reward"),
        Column("abs_td_error_shaped", Kind.NUMBER, "Mean of |td_error_shaped| over them.", "reward"),
        Column("discounted_return", Kind.NUMBER, "Sum over its steps t of gamma^t (r + h).", "reward"),
        Column("discounted_env_return", Kind.NUMBER, "Sum over its steps t of gamma^t r.", "reward"),
        Column("inputs", Kind.WHOLE, "Answers applied in it.", "answers"),
        Column("agreements", Kind.WHOLE, "Steps with h above 0.", "steps"),
        _OUTCOME,
        _SHA256,
    )
    rows = []
    for at_ns, _, one, digest in story.episodes:
        rows.append((
            *(story.config.session, *_when(story, at_ns), one.episode, one.steps, one.optimal_steps),
            *(one.abs_td_error, one.abs_td_error_shaped, one.discounted_return, one.discounted_env_return),
            *(one.inputs, one.agreements, one.outcome.value, digest),
        ))  # fmt: skip
    return Table.of_rows("episodes", "Each row is one finished episode.", columns, rows)


def _states(story: Story) -> Table:
    views: dict[bytes, str] = {}
    for row in story.steps:
        views.setdefault(row.measures.state, row.measures.view)
        views.setdefault(row.next_state, row.measures.next_view)
    columns = (
        *(_SESSION, _STATE),
        Column("view", Kind.TEXT, "The state as teachers saw it, rows parted by line feeds (Sokoban: XSB)."),
    )
    rows = [(story.config.session, state.hex(), view) for state, view in views.items()]
    return Table.of_rows("states", "Each row is one state that the agent met, in that order.", columns, rows)


def _presence(story: Story) -> Table:
    columns = (
        *(_SESSION, _AT, _AT_S, _DECISION, _TEACHER),
        Column("event", Kind.TEXT, "joined or left."),
    )
    rows = [
        (story.config.session, *_when(story, at_ns), decision, teacher, event)
        for at_ns, decision, teacher, event in story.presence
    ]
    return Table.of_rows("presence", "Each row is a teacher who came or went.", columns, rows)
