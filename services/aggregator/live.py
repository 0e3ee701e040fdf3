"""One session's crowd in a running aggregator: the machine's state and what its shell keeps beside it."""

from collections import deque
from dataclasses import dataclass, field

from protocol.crowd_journal import HANDED_KEPT, AskedRow, CrowdConfig, FoldedCrowd, Handed
from protocol.crowd_message import Crowd as CrowdReport
from protocol.messages import Decision, Episode, Join, WindowSpec
from services.aggregator.upstream import Upstream
from services.runtime.bus import Request
from sfid_core.crowd.round import Asked, Crowd
from sfid_core.teaching.answers import AnswerKind

EPISODES_KEPT = 50
"""Latest episodes in a welcome, for the curves of a late joiner."""


@dataclass(slots=True)
class LiveCrowd:
    """One session; `crowd` is None until the learner has welcomed the aggregator for the first time."""

    name: str
    upstream: Upstream
    config: CrowdConfig | None = None
    crowd: Crowd | None = None
    numbers: dict[str, int] = field(default_factory=dict)
    known: set[str] = field(default_factory=set)
    """Workers who ever joined: one whose token comes back is present again without asking."""
    handed: deque[Handed] = field(default_factory=lambda: deque(maxlen=HANDED_KEPT))
    decision: Decision | None = None
    """The learner's, as it stands; None while the crowd is not welcomed."""
    asked: AskedRow | None = None
    """What was put to the crowd last: what a conclusion is an answer to."""
    sequence: int = 0
    announcing: bool = False
    """Who is there has changed, and an announcement of it waits."""
    episodes: deque[Episode] = field(default_factory=lambda: deque(maxlen=EPISODES_KEPT))
    waiting: dict[str, tuple[Join, Request]] = field(default_factory=dict)
    """Joins that wait for the learner's welcome, the latest of each worker."""
    timer_ns: int | None = None
    finished: bool = False
    leaving: bool = False
    """The crowd is empty: leave the learner once everything is acknowledged."""
    too_late: int = 0
    answered_last: dict[str, None] = field(default_factory=dict)
    """Workers by their latest answer that counted, the latest last."""
    report: CrowdReport | None = None
    """What the monitor has not been told yet."""
    reported_at_ns: int = 0

    def take_up(self, folded: FoldedCrowd) -> None:
        """Stand where the journal says."""
        self.begin(folded.config, folded.crowd)
        self.known, self.handed, self.finished = folded.known, folded.handed, folded.finished
        self.asked = folded.asked

    def begin(self, config: CrowdConfig, crowd: Crowd) -> None:
        """Have a crowd from now on."""
        self.config, self.crowd = config, crowd
        self.numbers = {name: index for index, name in enumerate(config.actions)}

    @property
    def actions(self) -> tuple[str, ...]:
        """Names of the session's actions by index."""
        return () if self.config is None else self.config.actions

    def was_handed(self, decision: Decision) -> bool:
        """Tell whether the crowd has given its answer to this question."""
        key = decision.decision, decision.state, decision.asked
        return any((handed.decision, handed.state, handed.asked) == key for handed in self.handed)


def has_passed(asked: Asked, decision: Decision) -> bool:
    """Tell whether the learner has gone on without an answer to what was asked.

    A learner that was killed stands a step or two behind where it was and asks the same again: what was said
    waits for it.
    """
    if decision.phase == "finished" or decision.decision != asked.decision:
        return decision.phase == "finished" or decision.decision > asked.decision
    if decision.phase == "executing":
        return asked.kind in (AnswerKind.LABEL, AnswerKind.GUIDANCE)
    same = (decision.asked, decision.state) == (asked.kind.value, asked.state)
    return decision.phase == "asking" and not same


def shown(live: LiveCrowd, decision: Decision, epoch: int, at_ns: int) -> Decision:
    """Return the learner's decision as the crowd is to see it."""
    crowd, config = live.crowd, live.config
    assert crowd is not None  # noqa: S101 - told to the type checker: a crowd is begun before anything is shown
    assert config is not None  # noqa: S101 - as above
    asking = crowd.round is not None
    deadline_ns = crowd.round.deadline_ns if crowd.round is not None else None
    window = decision.window
    return Decision(
        session=live.name,
        epoch=epoch,
        sequence=live.sequence,
        decision=decision.decision,
        episode=decision.episode,
        step=decision.step,
        phase="executing" if decision.phase == "asking" and not asking else decision.phase,
        paused=decision.paused,
        asked=decision.asked,
        state=decision.state,
        view=decision.view,
        actions=decision.actions,
        action=decision.action,
        remaining_ms=None if deadline_ns is None else max(0, deadline_ns - at_ns) // 1_000_000,
        window=WindowSpec(mode=window.mode, span_ms=window.span_ms, quorum=config.rounds.quorum),
        # Strangers are counted, not named.
        teachers=(),
        teachers_present=len(crowd.members),
        method=decision.method,
        episodes=decision.episodes,
        optimal_steps=decision.optimal_steps,
    )
