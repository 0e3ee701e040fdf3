"""One checker a rule of ARCHITECTURE.md: a function from the evidence to what is wrong, a line each."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from hashlib import blake2b

from protocol.messages import LabelTotals, Step
from services.simulate.evidence import Evidence, Kept
from services.simulate.model import Table, moved, opinion, verdict

ALPHA, GAMMA = 0.1, 0.9
"""The founding paper's, with which every lesson is taught."""
Check = Callable[[Evidence], Iterator[str]]


def r1_acknowledged_is_kept(evidence: Evidence) -> Iterator[str]:
    """An acknowledged answer is in the journal, once, with the content that its teacher sent."""
    rows: dict[bytes, list[Kept]] = defaultdict(list)
    for kept in evidence.kept:
        rows[kept.answer.answer_id].append(kept)
    for told in evidence.told:
        reply, name = told.reply, told.reply.answer_id.hex()[:8]
        found = rows[reply.answer_id]
        if reply.check != blake2b(told.payload, digest_size=8).digest():
            yield f"answer {name}: acknowledged with the check of another content"
        if len(found) != 1:
            yield f"answer {name}: acknowledged as {reply.code}, and {len(found)} times in the journal"
        elif reply.code != "conflict" and found[0].payload != told.content:
            yield f"answer {name}: acknowledged as {reply.code}, but another content is in the journal"
        elif found[0].seq != reply.journal_seq:
            yield f"answer {name}: acknowledged as row {reply.journal_seq}, is row {found[0].seq}"
    yield from _crowd_is_kept(evidence)
    for teacher, left in evidence.history.unacknowledged.items():
        yield f"{left} answers of {teacher} were never acknowledged"
    for problem in evidence.history.problems:
        yield f"the journal does not verify: {problem}"


def _crowd_is_kept(evidence: Evidence) -> Iterator[str]:
    """The same for what workers were told by an aggregator, whose rows hold what they sent as it came."""
    rows = {row.seq: row for row in evidence.crowd_rows}
    ids = Counter(row.answer_id for row in evidence.crowd_rows if row.answer_id is not None)
    for told in evidence.crowd_told:
        reply, name = told.reply, told.reply.answer_id.hex()[:8]
        row = rows.get(reply.journal_seq)
        if ids[reply.answer_id] != 1:
            yield f"worker's answer {name}: acknowledged, and {ids[reply.answer_id]} times in the journal"
        elif row is None or row.answer_id != reply.answer_id:
            yield f"worker's answer {name}: acknowledged as row {reply.journal_seq}, which is another"
        elif (told.content in row.body) is (reply.code == "conflict"):
            yield f"worker's answer {name}: acknowledged as {reply.code}, which its row does not bear out"


def r2_same_id_same_acknowledgement(evidence: Evidence) -> Iterator[str]:
    """The same id with the same content gets the same acknowledgement, with another one it is a conflict."""
    kept = {one.answer.answer_id: one for one in evidence.kept}
    for told in evidence.told:
        reply, name = told.reply, told.reply.answer_id.hex()[:8]
        row = kept.get(reply.answer_id)
        if row is None:
            continue
        expected = row.code if row.payload == told.content else "conflict"
        if reply.code != expected:
            yield f"answer {name}: told {reply.code} instead of {expected}"


def r3_q_is_a_fold_of_the_journal(evidence: Evidence) -> Iterator[str]:
    """Live table, replay and the model's own learning from the journal have one digest."""
    report, replayed = evidence.report, evidence.history.replayed
    if report is None or replayed is None:
        return
    if report.q_sha256 != replayed[0]:
        yield f"live table {report.q_sha256[:12]}, replayed {replayed[0][:12]}"
    if not replayed[1]:
        yield "the replay differs from a noted digest, or from what a teacher was told"
    modelled = _modelled(evidence)
    if modelled != replayed[0]:
        yield f"replayed {replayed[0][:12]}, by the model {modelled[:12]}"


def _modelled(evidence: Evidence) -> str:
    table = Table(ALPHA, GAMMA)
    said: dict[int, list[Kept]] = defaultdict(list)
    for (decision, _), answers in evidence.accepted().items():
        said[decision].append(answers[-1])
    for state, taken in evidence.transitions():
        action = evidence.actions.get(taken.decision, "LEFT")
        after = None if taken.outcome in {"solved", "deadlock", "failed"} else taken.state
        table.learn(state, action, taken.reward, _h(said[taken.decision], action), after)
    return table.sha256()


def _h(said: list[Kept], action: str) -> float:
    if len(said) == 1 and said[0].answer.posterior and said[0].answer.action:
        return 2.0 * said[0].answer.posterior.get(action, 0.0) - 1.0
    label = opinion(one.answer.action for one in said if one.answer.kind == "label" and one.answer.action)
    if label is not None:
        return 1.0 if label == action else -1.0
    rewards = [one.answer.reward for one in said if one.answer.kind == "reward"]
    return verdict([reward for reward in rewards if reward is not None])


def r4_one_answer_of_a_teacher_counts(evidence: Evidence) -> Iterator[str]:
    """At most one answer of a teacher counts for a decision: the last one before the close."""
    accepted = evidence.accepted()
    by_decision = defaultdict(set)
    for decision, teacher in accepted:
        by_decision[decision].add(teacher)
    for step in evidence.last_steps.values():
        names = [said.teacher for said in step.said]
        if len(set(names)) != len(names):
            yield f"decision {step.decision}: several answers of one teacher count: {', '.join(names)}"
        expected = by_decision[step.decision]
        if set(names) != expected:
            yield (
                f"decision {step.decision}: answers of {sorted(names)} count, "
                f"accepted were those of {sorted(expected)}"
            )
        for said in step.said:
            last = accepted.get((step.decision, said.teacher), [])
            if last and (said.kind, said.action, said.reward) != _content(last[-1]):
                yield f"decision {step.decision}: of {said.teacher} counts another answer than the last one"


def _content(kept: Kept) -> tuple[str, str | None, float | None]:
    answer = kept.answer
    return answer.kind, answer.action, answer.reward


def r5_bound_to_its_decision_and_state(evidence: Evidence) -> Iterator[str]:
    """An answer is bound to the decision and state it was given for, and never applied to another."""
    steps = evidence.last_steps
    for (decision, teacher), answers in evidence.accepted().items():
        for one in answers:
            if decision in steps and one.answer.state != steps[decision].state:
                yield f"decision {decision}: an answer of {teacher} for another state was accepted"
    given = defaultdict(set)
    for one in evidence.kept:
        given[one.answer.decision, one.answer.teacher].add(_content(one))
    for step in steps.values():
        for said in step.said:
            if (said.kind, said.action, said.reward) not in given[step.decision, said.teacher]:
                yield f"decision {step.decision}: what counts for {said.teacher} was not said about it"
        if not evidence.history.scenario.lesson.crowd and step.h != _h_of(step):
            yield f"decision {step.decision}: h is {step.h}, by what was said it is {_h_of(step)}"


def _h_of(step: Step) -> float:
    label = opinion(said.action for said in step.said if said.kind == "label" and said.action)
    if label is not None:
        return 1.0 if label == step.action else -1.0
    return verdict([said.reward for said in step.said if said.kind == "reward" and said.reward is not None])


def r6_counts_add_up(evidence: Evidence) -> Iterator[str]:
    """The sum holds: submitted = applied + superseded + late + rejected + pending, at every moment."""
    for number, report in enumerate(evidence.reports):
        totals = report.labels
        parts = totals.applied + totals.superseded + totals.late + totals.rejected + totals.pending
        if parts != totals.submitted or min(totals.pending, totals.applied) < 0:
            yield f"report {number}: submitted {totals.submitted}, the parts sum to {parts}"
    if evidence.report is not None:
        expected = _counted(evidence)
        found = evidence.report.labels
        names = expected.__struct_fields__
        wrong = [name for name in names if getattr(found, name) != getattr(expected, name)]
        for name in wrong:
            yield f"{name}: {getattr(found, name)}, by the journal {getattr(expected, name)}"


def _counted(evidence: Evidence) -> LabelTotals:
    codes = Counter(one.code for one in evidence.kept if one.counted)
    overtaken = sum(sum(one.counted for one in answers[:-1]) for answers in evidence.accepted().values())
    return LabelTotals(
        submitted=codes.total(),
        acknowledged=codes.total() - codes["rejected"],
        applied=codes["accepted"] - overtaken,
        superseded=codes["superseded"] + overtaken,
        late=codes["late"],
        rejected=codes["rejected"],
        pending=0,
    )


def r7_executed_once(evidence: Evidence) -> Iterator[str]:
    """Every decision is executed once; a repeat is answered with the same result."""
    for (_, _, decision, _, action), replies in evidence.executed.items():
        if len(replies) > 1:
            yield f"decision {decision}: {action} was answered with {len(replies)} different results"
    for step in evidence.steps:
        if moved(step.view, step.action) != step.next_view:
            yield f"decision {step.decision}: {step.action} once does not lead to what was reported"


def r8_nobody_is_waited_for_in_vain(evidence: Evidence) -> Iterator[str]:
    """A teacher who leaves or dies stops nobody: every session comes to its end."""
    if evidence.report is None:
        done = len(evidence.last_steps)
        yield f"the session stands still after {done} steps, though every fault is over"


def r9_steps_without_a_gap(evidence: Evidence) -> Iterator[str]:
    """Steps of an episode are 0, 1, 2 ... without a gap, across restarts of any process."""
    episode, step, places = -1, 0, []
    for row in evidence.rows:
        if row.kind == "began":
            episode, step = episode + 1, 0
        elif row.kind == "step":
            places.append((episode, step))
            step += 1
    taken = evidence.transitions()
    numbers = [one.decision for _, one in taken]
    if numbers != list(range(len(numbers))):
        yield f"decisions in the journal are {_shown(numbers)}"
    for step_message in evidence.last_steps.values():
        number, place = step_message.decision, (step_message.episode, step_message.step)
        if number >= len(places) or places[number] != place:
            yield f"decision {number}: published as episode and step {place}, journaled otherwise"
    if evidence.report is not None:
        steps = [one.steps for one in evidence.report.episodes]
        counted = Counter(at for at, _ in places)
        if steps != [counted[number] for number in range(len(steps))]:
            yield f"episodes have {_shown(steps)} steps in the report, others in the journal"
        if len(steps) != evidence.history.scenario.lesson.config.episodes:
            yield f"the session has {len(steps)} episodes"


def _shown(numbers: list[int]) -> str:
    return ", ".join(map(str, numbers[:20])) + (" ..." if len(numbers) > 20 else "")


def r0_processes_live(evidence: Evidence) -> Iterator[str]:
    """No process ends by itself: what the trials and the disk do to it is all that kills it."""
    yield from evidence.history.died_of


RULES: dict[str, Check] = {
    "R0": r0_processes_live,
    "R1": r1_acknowledged_is_kept,
    "R2": r2_same_id_same_acknowledgement,
    "R3": r3_q_is_a_fold_of_the_journal,
    "R4": r4_one_answer_of_a_teacher_counts,
    "R5": r5_bound_to_its_decision_and_state,
    "R6": r6_counts_add_up,
    "R7": r7_executed_once,
    "R8": r8_nobody_is_waited_for_in_vain,
    "R9": r9_steps_without_a_gap,
}
"""R10 needs two runs: see campaign.py."""
