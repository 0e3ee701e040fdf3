"""Between the wire's messages and the core's types: action names and numbers, texts and enums."""

import sys
from collections.abc import Mapping, Sequence
from functools import lru_cache
from math import inf

from protocol import messages as wire
from protocol.fields import Asked
from protocol.world_messages import UNDO
from sfid_core.session.config import SessionConfig, Window, WindowMode, WorldSpec
from sfid_core.session.events import AnswerGiven
from sfid_core.session.measures import EpisodeMeasures, LabelCounts, StepMeasures
from sfid_core.session.state import Phase, Session
from sfid_core.sokoban.actions import Action
from sfid_core.teaching.answers import Answer, AnswerKind
from sfid_core.teaching.merge import ACTIONS_MAX

TEACHERS_NAMED_MAX = 64
"""Names listed in one decision message; a crowd is counted, not named."""


class UnknownAction(ValueError):  # noqa: N818 - it names what is wrong
    """A message says of actions what cannot be in this session; the text is one line with the mend."""


def action_names(world: wire.World | wire.GymWorld) -> tuple[str, ...]:
    """Return the names of a world's actions by their index in the core."""
    return world.actions if isinstance(world, wire.GymWorld) else tuple(action.name for action in Action)


def config_of(message: wire.CreateSession) -> SessionConfig:
    """Return the core's configuration; raise ParameterError with the mend when a value is out of range."""
    return SessionConfig(
        message.session,
        _world_spec(message.world),
        message.method,
        message.parameters,
        message.episodes,
        message.seed,
        window_of(message.window),
        message.teachers_min,
    )


def _world_spec(world: wire.World | wire.GymWorld) -> WorldSpec:
    if isinstance(world, wire.World):
        return _sokoban(world)
    goal = inf if world.goal_reward is None else world.goal_reward
    return WorldSpec(
        "", world.level_name, world.starts, goal, world.step_reward, deadlock_reward=-inf,
        steps_max=world.steps_max,
    )  # fmt: skip


@lru_cache(256)  # shared by all sessions of a world
def _sokoban(world: wire.World) -> WorldSpec:
    return WorldSpec(
        sys.intern(world.level),  # of equal worlds any may come first
        world.level_name,
        world.starts,
        world.goal_reward,
        world.step_reward,
        world.deadlock_reward,
        world.steps_max,
    )


@lru_cache(256)  # shared by all sessions of a window
def window_of(spec: wire.WindowSpec) -> Window:
    """Return the core's window."""
    return Window(WindowMode(spec.mode), spec.span_ms, spec.quorum)


def window_spec(window: Window) -> wire.WindowSpec:
    """Return the wire's window."""
    return wire.WindowSpec(mode=window.mode.value, span_ms=window.span_ms, quorum=window.quorum)


def answer_given(message: wire.Answer, numbers: Mapping[str, int]) -> AnswerGiven:
    """Return the answer as an event of the session.

    Args: numbers: action name to index. Raises: UnknownAction.
    """
    bare = (
        message.kind == "label"
        and message.action in numbers
        and message.posterior is None
        and message.reward is None
        and message.mistake is None
        and not message.guidance
    )
    answer = _LABELS[numbers[message.action]] if bare and message.action else _answer(message, numbers)
    return AnswerGiven(message.teacher, message.answer_id, message.decision, message.state, answer)


def check_posterior(message: wire.Answer) -> None:
    """Refuse probabilities of actions that do not add up to 1; raises UnknownAction.

    At the edge alone: what is in a journal was let in, and is read as it stands.
    """
    if message.posterior is None:
        return
    total = sum(message.posterior.values())
    if abs(total - 1.0) > POSTERIOR_SLACK:
        text = f"a posterior's probabilities add up to {total:g}: divide each by that, or leave it out"
        raise UnknownAction(text)


POSTERIOR_SLACK = 1e-6
"""What rounding may leave of 1 in a sum of probabilities."""
_LABELS = tuple(Answer(AnswerKind.LABEL, action) for action in range(ACTIONS_MAX))
"""What nearly every answer is: an action and nothing else."""


def _answer(message: wire.Answer, numbers: Mapping[str, int]) -> Answer:
    try:
        answer = Answer(
            _KINDS[message.kind],
            None if message.action is None else numbers[message.action],
            message.reward,
            tuple(numbers[name] for name in message.guidance),
            None if message.mistake is None else (message.mistake.first_step, message.mistake.last_step),
            () if message.posterior is None else _posterior(message.posterior, numbers),
        )
    except KeyError as error:
        text = f"action {error.args[0]!r} is not of this session: use one of {', '.join(numbers)}"
        raise UnknownAction(text) from None
    if answer.kind is AnswerKind.LABEL and answer.action is None:
        text = f"a label names an action: use one of {', '.join(numbers)}, or the kind abstain"
        raise UnknownAction(text)
    if answer.kind is AnswerKind.REWARD and answer.reward is None:
        text = "a reward has a value from -1 to 1: give one, or the kind abstain"
        raise UnknownAction(text)
    if answer.kind is AnswerKind.GUIDANCE and not answer.guidance:
        text = (
            f"guidance names the actions worth considering: some of {', '.join(numbers)}, or the kind abstain"
        )
        raise UnknownAction(text)
    if answer.kind is AnswerKind.MISTAKE and answer.steps is None:
        text = "a mark names its first and last step: give `mistake`, or the kind abstain"
        raise UnknownAction(text)
    return answer


_KINDS = {kind.value: kind for kind in AnswerKind}
_ASKED: dict[AnswerKind | None, Asked] = {
    None: "nothing",
    AnswerKind.LABEL: "label",
    AnswerKind.REWARD: "reward",
    AnswerKind.GUIDANCE: "guidance",
    AnswerKind.UNDO: "undo",
    AnswerKind.MISTAKE: "mistake",
}


def _posterior(posterior: Mapping[str, float], numbers: Mapping[str, int]) -> tuple[float, ...]:
    for name in posterior:
        numbers[name]  # a name that is not an action is an error, not a zero
    return tuple(posterior.get(name, 0.0) for name in numbers)


def named(action: int, actions: Sequence[str]) -> str:
    """Return the name of an action by its index; the index behind the last takes the last step back."""
    return actions[action] if action < len(actions) else UNDO


def decision_message(session: Session, actions: Sequence[str], sequence: int, at_ns: int) -> wire.Decision:
    """Return the decision as it stands, for everyone who watches or teaches."""
    judging = session.transition
    asks = session.asks
    deadline_ns = session.deadline_ns
    names = sorted(session.teachers)
    return wire.Decision(
        session=session.config.session,
        epoch=session.epoch,
        sequence=sequence,
        decision=session.decision,
        episode=session.episode,
        step=session.step,
        phase=session.phase.value,
        paused=session.paused,
        asked=_ASKED[asks],
        state=session.state,
        view=session.view if judging is None else judging.view,
        actions=tuple(actions),
        action=None if session.phase is Phase.ASKING and judging is None else named(session.action, actions),
        remaining_ms=None if deadline_ns is None else max(0, deadline_ns - at_ns) // 1_000_000,
        window=window_spec(session.window),
        teachers=tuple(names[:TEACHERS_NAMED_MAX]),
        teachers_present=len(names),
        method=session.config.method,
        episodes=session.config.episodes,
        optimal_steps=session.optimal_steps,
        may_undo=session.learner.method.may_undo,
    )


def step_message(step: StepMeasures, session: Session, actions: Sequence[str], at_ns: int) -> wire.Step:
    """Return a learnt step for watchers."""
    said = tuple(
        wire.SaidBy(
            teacher=teacher,
            kind=answer.kind.value,
            action=None if answer.action is None else actions[answer.action],
            reward=answer.reward,
        )
        for teacher, answer in step.answers[:256]
    )
    return wire.Step(
        session=session.config.session,
        epoch=session.epoch,
        decision=step.decision,
        episode=step.episode,
        step=step.step,
        at_ns=at_ns,
        state=step.state,
        view=step.view,
        action=named(step.action, actions),
        said=said,
        label=None if step.label is None else actions[step.label],
        h=step.learned.h,
        reward=step.reward,
        td_error=step.learned.environment,
        td_error_shaped=step.learned.shaped,
        outcome=step.outcome.value,
        next_view=step.next_view,
        values=step.values,
    )


def episode_message(episode: EpisodeMeasures, session: Session, at_ns: int) -> wire.Episode:
    """Return a finished episode for watchers and reports."""
    return wire.Episode(
        session=session.config.session,
        epoch=session.epoch,
        decision=session.decision,
        at_ns=at_ns,
        episode=episode.episode,
        steps=episode.steps,
        optimal_steps=episode.optimal_steps,
        abs_td_error=episode.abs_td_error,
        abs_td_error_shaped=episode.abs_td_error_shaped,
        discounted_return=episode.discounted_return,
        discounted_env_return=episode.discounted_env_return,
        inputs=episode.inputs,
        agreements=episode.agreements,
        outcome=episode.outcome.value,
    )


def label_totals(counts: LabelCounts) -> wire.LabelTotals:
    """Return the label counts for a report."""
    return wire.LabelTotals(
        submitted=counts.submitted,
        acknowledged=counts.acknowledged,
        applied=counts.applied,
        superseded=counts.superseded,
        late=counts.late,
        rejected=counts.rejected,
        pending=counts.pending,
    )
