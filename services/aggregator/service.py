"""The aggregator's shell: journals what happens to crowds, advances them, performs what follows."""

import logging
import secrets
import threading
from collections.abc import Callable
from random import Random
from typing import Any

from protocol.codec import DecodeError, encode
from protocol.crowd_journal import (
    AskedRow,
    CrowdConfig,
    CrowdKind,
    asked_event,
    config_body,
    fold_crowd,
    name_body,
    row_body,
)
from protocol.journal import Record
from protocol.keys import Keys
from protocol.messages import Decision, Refusal, Welcome
from services.aggregator.attendance import Attendance
from services.aggregator.config import AggregatorConfig
from services.aggregator.handing import Handing
from services.aggregator.live import LiveCrowd, has_passed, shown
from services.aggregator.optima import Optima
from services.aggregator.reception import Reception
from services.aggregator.relay import Relay
from services.aggregator.report import Reporter
from services.aggregator.upstream import Upstream
from services.client import AnswerState, AnswerUpdate, EpisodeOver, Learnt, Opened, Refused, Update, Welcomed
from services.runtime.bus import Bus
from services.runtime.clock import Clock
from services.runtime.durable_loop import DurableLoop, LoopSettings
from services.runtime.journal import JournalError, Shard
from services.runtime.status import StatusDesk
from sfid_core.chance import stream, unit
from sfid_core.crowd.round import (
    Announce,
    Cause,
    Closed,
    Concluded,
    Crowd,
    Due,
    Effect,
    MemberJoined,
    MemberLeft,
    advance,
)
from sfid_core.teaching.answers import AnswerKind

log = logging.getLogger("sfid.aggregator")

UPSTREAM_TICK_MS = 100
"""How often a client that nothing comes to is asked whether it has something to repeat."""
ANNOUNCE_MS = 200
"""How long a change of who is there may wait to be told: 200 who join at once are one announcement."""
_AGGREGATED = {
    kind.value: kind
    for kind in (AnswerKind.LABEL, AnswerKind.REWARD, AnswerKind.GUIDANCE, AnswerKind.MISTAKE)
}
_CHANCE = secrets.SystemRandom()


class Aggregator:
    """All crowds of one process. Bus callbacks only enqueue; the rest happens in `turn`, on one thread."""

    def __init__(
        self, config: AggregatorConfig, bus: Bus, shard: Shard, clock: Clock, *,
        optima: Optima | None = None, chance: Random = _CHANCE,
    ) -> None:  # fmt: skip
        self.config, self.bus, self.shard = config, bus, shard
        self.learners, self.keys = Keys(config.deployment), Keys(config.crowd_deployment)
        self.crowds: dict[str, LiveCrowd] = {}
        settings = LoopSettings("aggregator", config.inbox_max, config.waiting_max, config.commit_every_ms)
        self.loop = DurableLoop(shard, clock, settings)
        self._clock, self._chance = clock, chance
        self._optima = optima or Optima()
        self._gold = stream(config.seed, "gold", config.name)
        self.attendance = Attendance(self)
        self.reporter = Reporter(self)
        self.handing = Handing(self, chance)
        self.reception = Reception(self)

    # ------------------------------------------------------------ life

    def open(self) -> None:
        """Rebuild every crowd from the journal and take up its sessions; then serve."""
        for name in self.shard.sessions():
            rows = (
                Record(row.kind, row.at_ns, row.body) for row in self.shard.rows(name) if row.body is not None
            )
            try:
                folded = fold_crowd(rows)
            except DecodeError as error:
                message = f"session {name}: its crowd's journal cannot be read by this version ({error})"
                raise JournalError(message) from None
            if folded is not None:
                self._live(name).take_up(folded)
        self._declare()
        for live in self.crowds.values():
            if not live.finished:
                # Also when nobody is there any more: what was concluded last may not have been handed on.
                live.upstream.enter(live.handed)
                log.info("session %s: its crowd goes on, epoch %d", live.name, self.shard.epoch)
        self.attendance.expect_all()
        self.reception.desk.let_go(self.attendance.let_go)

    def _declare(self) -> None:
        keys, receiver = self.keys, self.loop.receiver
        self.bus.watch(
            keys.presences(), lambda presence: self.loop.enqueue(self.attendance.on_presence, presence)
        )
        self.bus.serve(keys.answer(), receiver(self.reception.on_answer))
        self.bus.serve(keys.join(), receiver(self.reception.on_join))
        self.bus.serve(keys.control(), receiver(self.reception.on_control))
        Relay(self.bus, self.learners).open(keys)
        desk = StatusDesk("aggregator", self.config.name, self._clock, self._facts)
        status = self.learners.status("aggregator", self.config.name)
        self.bus.serve(status, receiver(desk.reply, needs_journal=False))
        self.bus.announce(self.learners.service("aggregator", self.config.name))

    def _facts(self) -> dict[str, Any]:
        lives = self.crowds.values()
        return {
            "backlog": self.loop.waiting,
            "sessions": len(lives),
            "running": sum(not live.finished for live in lives),
            "teachers": sum(len(live.crowd.members) for live in lives if live.crowd is not None),
            "refused": self.reception.desk.refusals(),
            **self.loop.commits.facts(),
        }

    def run(self, stop: threading.Event) -> None:
        """Turn until `stop` is set, then drain: nothing that was acknowledged waits in memory afterwards."""
        self.loop.run(stop)
        for live in self.crowds.values():
            self.reporter.note(live)
            live.upstream.leave()
        self.loop.commit()
        log.info("aggregator drained: %d crowds", len(self.crowds))

    def turn(self, timeout_s: float) -> None:
        """See DurableLoop.turn."""
        self.loop.turn(timeout_s)

    def crowd_of(self, session: str) -> LiveCrowd | None:
        """Return a session's crowd, a new one where there may be one, or None."""
        found = self.crowds.get(session)
        if found is not None:
            return found
        allowed = not self.config.sessions or session in self.config.sessions
        if not allowed or len(self.crowds) >= self.config.sessions_max:
            return None
        return self._live(session)

    def _live(self, session: str) -> LiveCrowd:
        door = self.reception.desk.door
        upstream = Upstream(
            self.bus, self.learners, session, self.config.name,
            wake=lambda: self.loop.enqueue(self._pump, live), clock=self._clock, chance=self._chance,
            token=None if door is None else door.own(session, self.config.name),
        )  # fmt: skip
        live = self.crowds[session] = LiveCrowd(session, upstream)
        self.loop.call_later(UPSTREAM_TICK_MS, self._tick, live)
        return live

    # ------------------------------------------------------------ the learner's side

    def _tick(self, live: LiveCrowd) -> None:
        if self.crowds.get(live.name) is live:
            self._pump(live)
            self.loop.call_later(UPSTREAM_TICK_MS, self._tick, live)

    def _pump(self, live: LiveCrowd) -> None:
        for update in live.upstream.updates():
            self._on_update(live, update)
        if live.leaving and not live.upstream.unacknowledged:
            live.leaving, live.decision = False, None
            live.upstream.leave()
            log.info("session %s: the crowd is empty and leaves", live.name)

    def _on_update(self, live: LiveCrowd, update: Update) -> None:
        match update:
            case Opened(decision, received_ns):
                self._on_decision(live, decision, received_ns)
            case Welcomed(welcome):
                self._on_welcome(live, welcome)
            case Learnt(step):
                self.bus.publish(self.keys.measures(live.name), encode(step))
            case EpisodeOver(episode):
                live.episodes.append(episode)
                self.bus.publish(self.keys.measures(live.name), encode(episode))
            case Refused(reason=reason):
                self._on_refused(live, reason)
            case AnswerUpdate(state=AnswerState.TOO_LATE | AnswerState.REJECTED):
                self.handing.refused(live, update)

    def _on_welcome(self, live: LiveCrowd, welcome: Welcome) -> None:
        live.episodes.clear()
        live.episodes.extend(welcome.episodes)
        heard, told = live.decision, welcome.decision
        if heard is None or heard.epoch != told.epoch or heard.sequence <= told.sequence:
            live.decision = heard = told  # else the welcome was overtaken on its way
        if live.crowd is None:
            config = CrowdConfig(
                self.config.name, welcome.decision.actions, self.config.rounds, self.config.weighing
            )
            live.begin(config, Crowd(config.rounds, config.weighing, len(config.actions)))
            self.loop.append(live.name, CrowdKind.CREATED.value, config_body(config), self.loop.at_ns())
            log.info("session %s has a crowd: %s", live.name, config.weighing.method)
        waiting, live.waiting = live.waiting, {}
        for message, request in waiting.values():
            self.reception.welcome(live, message, request)
        # It may have been heard before, when there was no crowd to put it to.
        self._on_decision(live, heard, self._clock.now_ns())

    def _on_refused(self, live: LiveCrowd, reason: str) -> None:
        waiting, live.waiting = live.waiting, {}
        refusal = encode(Refusal(code="unknown-session", reason=f"the learner says: {reason}"[:512]))
        for _, request in waiting.values():
            request.reply_error(refusal)
        if live.crowd is None:  # anybody may ask for any session: keep only those that are
            live.upstream.leave()
            del self.crowds[live.name]

    def _on_decision(self, live: LiveCrowd, decision: Decision, received_ns: int) -> None:
        live.decision = decision
        crowd = live.crowd
        if crowd is None:
            return
        kind = _AGGREGATED.get(decision.asked) if decision.phase == "asking" else None
        open_round = crowd.round
        if open_round is not None and has_passed(open_round.asked, decision):
            self.close(live, Cause.OVERTAKEN, tell=False)
        if decision.phase == "finished" and not live.finished:
            self._finish(live)
        if kind is not None and not live.was_handed(decision) and decision.actions == live.actions:
            self._put(live, decision, kind, received_ns)
        else:
            self.publish_decision(live)

    def _put(self, live: LiveCrowd, decision: Decision, kind: AnswerKind, received_ns: int) -> None:
        """Put a decision to the crowd, or tell it how the open one stands."""
        crowd, at_ns = live.crowd, self.loop.at_ns()
        assert crowd is not None  # noqa: S101 - told to the type checker: the caller has looked
        question = decision.decision, decision.state, kind
        again = crowd.round is not None and crowd.round.asked[:3] == question
        row = self._asked_row(live, decision, kind, received_ns, known=again)
        if not again:
            live.asked = row
            self.loop.append(live.name, CrowdKind.ASKED.value, row_body(row), at_ns)
        self.perform(live, advance(crowd, at_ns, asked_event(row)))

    def _asked_row(
        self, live: LiveCrowd, decision: Decision, kind: AnswerKind, received_ns: int, *, known: bool
    ) -> AskedRow:
        remaining_ms = decision.remaining_ms
        if remaining_ms is not None:
            waited_ms = max(0, self._clock.now_ns() - received_ns) // 1_000_000
            remaining_ms = max(0, remaining_ms - waited_ms)
        optimal: tuple[int, ...] = ()
        if self.config.solver and kind is AnswerKind.LABEL and not known:
            optimal = tuple(
                sorted(
                    live.numbers[name] for name in self._optima.names(decision.view) if name in live.numbers
                )
            )
        gold = len(optimal) == 1 and unit(self._gold, decision.decision) < self.config.gold_share
        judged = live.numbers.get(decision.action or "") if kind is AnswerKind.REWARD else None
        return AskedRow(
            decision.epoch, decision.decision, decision.episode, decision.step, decision.state,
            decision.view, decision.asked, judged, remaining_ms, decision.window.mode == "full",
            decision.paused, optimal, gold,
        )  # fmt: skip

    def _finish(self, live: LiveCrowd) -> None:
        live.finished = True
        self.reporter.note(live)
        self.loop.append(live.name, CrowdKind.FINISHED.value, b"", self.loop.at_ns())
        log.info("session %s is finished", live.name)

    # ------------------------------------------------------------ the crowd's side

    def happen(self, live: LiveCrowd, event: MemberJoined | MemberLeft) -> None:
        """Journal that a member came or went, and let it take effect."""
        if live.crowd is None:
            return
        at_ns = self.loop.at_ns()
        joined = isinstance(event, MemberJoined)
        kind = CrowdKind.JOINED if joined else CrowdKind.LEFT
        self.loop.append(live.name, kind.value, name_body(event.worker), at_ns, None, event.worker)
        effects = advance(live.crowd, at_ns, event)
        if joined:
            live.known.add(event.worker)
        self.perform(live, effects, hurry=False)
        self.stay_or_leave(live)

    def stay_or_leave(self, live: LiveCrowd) -> None:
        """Be the learner's teacher while anybody is in the crowd: an empty one holds nobody up."""
        empty = live.crowd is None or not live.crowd.members
        live.leaving = empty and live.upstream.present
        if not empty:
            live.upstream.enter(live.handed)

    def perform(self, live: LiveCrowd, effects: tuple[Effect, ...], *, hurry: bool = True) -> None:
        """Carry out what follows, acknowledgements apart; publish the decision once, as it then stands.

        Args: hurry: whether everybody must know at once; that somebody came or went can wait for the next.
        """
        announce = False
        for effect in effects:
            match effect:
                case Due(cause):
                    self.close(live, cause)
                    announce = False
                case Announce():
                    announce = True
        if announce and hurry:
            self.publish_decision(live)
        elif announce and not live.announcing:
            live.announcing = True
            self.loop.call_later(ANNOUNCE_MS, self._announce, live)
        self._set_timer(live)

    def _announce(self, live: LiveCrowd) -> None:
        if live.announcing:
            self.publish_decision(live)

    def close(self, live: LiveCrowd, cause: Cause, *, tell: bool = True) -> None:
        """Close the open round, journal what it came to, and hand that on once it is durable.

        Args: tell: whether the crowd is told now; else the caller publishes what comes next.
        """
        crowd, at_ns = live.crowd, self.loop.at_ns()
        assert crowd is not None  # noqa: S101 - told to the type checker: there is an open round
        for effect in advance(crowd, at_ns, Closed(cause)):
            if isinstance(effect, Concluded):
                message = self.handing.concluded(live, effect, at_ns)
                self.reporter.learnt(live, effect, message, at_ns)
        if tell:
            self.publish_decision(live)

    def _set_timer(self, live: LiveCrowd) -> None:
        deadline_ns = None if live.crowd is None or live.crowd.round is None else live.crowd.round.deadline_ns
        if deadline_ns is not None and deadline_ns != live.timer_ns:
            live.timer_ns = deadline_ns
            self.loop.call_at(deadline_ns, self._on_deadline, live)

    def _on_deadline(self, live: LiveCrowd) -> None:
        open_round = None if live.crowd is None else live.crowd.round
        deadline_ns = None if open_round is None else open_round.deadline_ns
        if deadline_ns is not None and deadline_ns <= self.loop.at_ns():
            self.close(live, Cause.DEADLINE)

    def publish_decision(self, live: LiveCrowd) -> None:
        """Publish the decision as the crowd is to see it."""
        if live.decision is not None and live.crowd is not None:
            live.sequence += 1
            live.announcing = False
            self.bus.publish(self.keys.decision(live.name), encode(self.shown(live, live.decision)))

    def shown(self, live: LiveCrowd, decision: Decision) -> Decision:
        """Return the decision as the crowd is to see it."""
        return shown(live, decision, self.shard.epoch, self.loop.at_ns())


def run(
    config: AggregatorConfig, bus: Bus, clock: Clock, ready: Callable[[], None], stop: threading.Event
) -> None:
    """Open the journal, take up every crowd and serve until `stop` is set."""
    with Shard.open(config.journal_dir) as shard:
        aggregator = Aggregator(config, bus, shard, clock)
        aggregator.open()
        ready()
        aggregator.run(stop)
