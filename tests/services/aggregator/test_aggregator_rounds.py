from pathlib import Path
from typing import Any

import msgspec
import pytest

from protocol.codec import decode
from protocol.messages import Acknowledgement, Decision, Join, MistakeMark, WindowSpec
from services.aggregator.config import AggregatorConfig
from sfid_core.crowd.round import RoundSettings
from sfid_core.crowd.settings import CrowdMethod, CrowdSettings
from sfid_core.learning.parameters import ParameterError
from sfid_core.sokoban.actions import Action
from sfid_core.teaching.answers import AnswerKind
from tests.services.aggregator.crowd_room import CROWD_KEYS, EARLY, CrowdRoom
from tests.services.learner.classroom import Pupil, optimal, session

MAJORITY = CrowdSettings(method=CrowdMethod.MAJORITY)


def room_of(path: Path, **config: Any) -> CrowdRoom:  # noqa: ANN401 - any field of the configuration
    return CrowdRoom(path / "data", config=config)


def causes(room: CrowdRoom) -> list[str]:
    return [closing.cause for closing, _ in room.folded().closings]


def test_a_round_closes_a_margin_before_the_learners_deadline(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(window=EARLY))
    ann, _silent = crowd_room.members("ann", "silent")
    ann.label("UP")
    crowd_room.pass_time(899)
    assert crowd_room.asked.phase == "asking"
    crowd_room.pass_time(1)
    assert causes(crowd_room) == ["deadline"]
    assert [step.label for step in crowd_room.steps] == ["UP"]


def test_nobody_waits_for_a_member_who_says_nothing_where_there_is_no_deadline(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    ann, _silent = crowd_room.members("ann", "silent")
    crowd_room.pass_time(60_000)
    assert crowd_room.asked.decision == 0
    ann.label("UP")
    crowd_room.pass_time(5_000)
    assert (causes(crowd_room), crowd_room.asked.decision) == (["deadline"], 1)


def test_a_full_window_is_waited_out(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(window=WindowSpec(mode="full", span_ms=1_000)))
    (ann,) = crowd_room.members("ann")
    ann.label("LEFT")
    ann.label("UP")
    assert causes(crowd_room) == []
    crowd_room.pass_time(900)
    assert (causes(crowd_room), crowd_room.asked.phase) == (["deadline"], "executing")
    crowd_room.pass_time(100)
    assert [step.label for step in crowd_room.steps] == ["UP"]


def test_a_quorum_closes_without_the_rest_and_tells_them(tmp_path: Path) -> None:
    room = room_of(tmp_path, rounds=RoundSettings(quorum=2), weighing=MAJORITY)
    room.create(session(window=EARLY))
    ann, bob, cat = room.members("ann", "bob", "cat")
    first = room.asked
    codes = [ann.label("UP", first), bob.label("UP", first), cat.label("UP", first)]
    room.pass_time(1_000)
    codes.append(cat.label("UP", first))
    found = causes(room)
    room.close()
    assert codes == ["accepted", "accepted", "superseded", "late"]
    assert found == ["quorum", "deadline"]  # the second decision: nobody answered


@pytest.mark.parametrize(
    "said",
    [
        {"ann": "UP", "bob": "DOWN"},
        {"ann": None, "bob": None},
        {"ann": "UP", "bob": "UP", "cat": "LEFT", "dan": "DOWN"},
    ],
)
def test_ties_silence_and_doubt_are_an_abstention_and_h_is_nothing(
    tmp_path: Path, said: dict[str, str | None]
) -> None:
    room = room_of(tmp_path, weighing=MAJORITY)
    room.create()
    for member in room.members(*said):
        action = said[member.name]
        member.say(kind="abstain") if action is None else member.label(action)
    (handed,) = room.learner_answers()
    posterior = handed.posterior or {}
    room.close()
    assert (handed.kind, handed.action, round(sum(posterior.values()), 12)) == ("abstain", None, 1.0)
    assert [(step.label, step.h) for step in room.steps] == [(None, 0.0)]


def test_a_round_that_nobody_answered_hands_on_nothing(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(window=EARLY))
    crowd_room.members("silent")
    crowd_room.pass_time(1_000)
    assert crowd_room.learner_answers() == []
    assert len(crowd_room.steps) == 1


def test_a_member_who_leaves_stops_nobody(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    ann, bob, cat = crowd_room.members("ann", "bob", "cat")
    ann.label("UP")
    bob.label("UP")
    cat.leave()
    assert (crowd_room.asked.decision, crowd_room.asked.teachers_present) == (1, 2)
    bob.leave()
    ann.label("LEFT")
    assert crowd_room.asked.decision == 2


def test_an_empty_crowd_leaves_the_learner_and_comes_back_with_its_first_member(
    crowd_room: CrowdRoom,
) -> None:
    crowd_room.create()
    ann, bob = crowd_room.members("ann", "bob")
    tom = Pupil(crowd_room, "tom")
    tom.join()
    ann.leave()
    bob.leave()
    crowd_room.pass_time(100)
    assert crowd_room.present() == ("tom",)
    tom.label(crowd_room.decision, "UP")  # an empty crowd holds nobody up
    assert len(crowd_room.steps) == 1
    ann.join()
    assert crowd_room.present() == ("crowd", "tom")
    assert ann.label("UP") == "accepted"
    tom.label(crowd_room.decision, "UP")
    assert len(crowd_room.steps) == 2


def test_a_member_who_shows_no_token_is_let_go(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    ann, ghost = crowd_room.members("ann", "ghost")
    ghost.bus.close()  # never heard of again
    crowd_room.settle()
    ann.label("UP")
    assert crowd_room.asked.decision == 1


def test_a_crowd_that_is_overtaken_learns_and_hands_on_nothing(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(window=WindowSpec(mode="early", span_ms=1_000, quorum=1)))
    ann, bob, _cat = crowd_room.members("ann", "bob", "cat")
    ann.label("UP")
    bob.label("UP")
    tom = Pupil(crowd_room, "tom")
    tom.join()
    tom.label(crowd_room.decision, "LEFT")
    assert causes(crowd_room) == ["overtaken"]
    assert [answer.teacher for answer in crowd_room.learner_answers()] == ["tom"]
    assert crowd_room.folded().crowd.conclusions == 1


def test_a_pause_holds_the_round_and_keeps_what_was_said(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(window=EARLY))
    ann, bob = crowd_room.members("ann", "bob")
    crowd_room.pass_time(500)
    crowd_room.operate("pause")
    codes = [ann.label("UP"), bob.label("UP")]
    crowd_room.pass_time(10_000)
    assert (codes, causes(crowd_room), crowd_room.asked.paused) == (["accepted"] * 2, [], True)
    crowd_room.operate("resume")
    assert (causes(crowd_room), crowd_room.asked.decision) == (["quorum"], 1)


def test_a_crowd_that_is_asked_for_rewards_gives_one(tmp_path: Path) -> None:
    room = room_of(tmp_path, weighing=MAJORITY)
    room.create(session(method="reward"))
    ann, bob, cat = room.members("ann", "bob", "cat")
    asked = room.asked
    for member, reward in ((ann, 1.0), (bob, 1.0), (cat, -1.0)):
        member.say(kind="reward", action=asked.action, reward=reward)
    (handed,) = room.learner_answers()
    room.close()
    assert (handed.kind, handed.action) == ("reward", asked.action)
    assert handed.reward == pytest.approx(1 / 3)
    assert room.steps[0].h == pytest.approx(1 / 3)


def test_a_crowd_guides_before_the_action_and_rewards_it_after(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(method="guidance"))
    ann, bob = crowd_room.members("ann", "bob")
    asked = [crowd_room.asked.asked]
    ann.say(kind="guidance", guidance=("LEFT", "UP"))
    bob.say(kind="guidance", guidance=("UP",))
    asked.append(crowd_room.asked.asked)
    for member in (ann, bob):
        member.say(kind="reward", action=crowd_room.asked.action, reward=1.0)
    handed = [(one.decision, one.kind, one.guidance) for one in crowd_room.learner_answers()]
    assert asked == ["guidance", "reward"]
    assert handed == [(0, "guidance", ("UP",)), (0, "reward", ())]
    assert [step.decision for step in crowd_room.steps] == [0]
    assert crowd_room.folded().mismatches == []


def test_a_crowd_marks_mistakes(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(method="marks"))
    ann, bob = crowd_room.members("ann", "bob")
    mark = MistakeMark(first_step=0, last_step=0)
    for member in (ann, bob):
        member.say(kind="mistake", action="UP", mistake=mark)
    (handed,) = crowd_room.learner_answers()
    assert (handed.kind, handed.action, handed.mistake) == ("mistake", "UP", mark)
    assert (len(crowd_room.steps), crowd_room.folded().mismatches) == (1, [])


def test_reliabilities_with_their_standard_errors_reach_the_monitor(tmp_path: Path) -> None:
    room = room_of(tmp_path, solver=False)
    room.create()
    members = room.members("ann", "bob", "cat")
    for _ in range(30):
        for member, action in zip(members, ("UP", "UP", "DOWN"), strict=True):
            member.label(action)
    room.pass_time(250)
    report = room.reports[-1]
    known = room.folded().crowd.aggregate(AnswerKind.LABEL)
    rows = {one.worker: (one.mean, one.standard_error, one.labels, one.present) for one in report.workers}
    room.close()
    assert (report.decision, report.members, report.answered, report.conclusions) == (29, 3, 3, 30)
    assert rows == {name: (*known.reliability(name)[:3], True) for name in ("ann", "bob", "cat")}
    assert rows["ann"][0] > 0.8
    assert rows["cat"][0] < 0.2


def test_reports_are_at_most_four_a_second_and_the_last_is_not_lost(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    (ann,) = crowd_room.members("ann")
    for _ in range(10):
        ann.label("UP")
    assert [report.decision for report in crowd_room.reports] == [0]
    crowd_room.pass_time(250)
    assert [report.decision for report in crowd_room.reports] == [0, 9]


def test_gold_states_measure_the_workers_unseen(tmp_path: Path) -> None:
    golden, plain = (room_of(tmp_path / name, gold_share=share) for name, share in (("g", 1.0), ("p", 0.0)))
    for room in (golden, plain):
        room.create()
        members = room.members("ann", "bob", "cat")
        for _ in range(60):  # two of three are wrong: without gold they would be believed
            best = optimal(room.asked.view)
            right = Action(best[0]) if best else Action.UP
            wrong = next(action for action in Action if action not in best)
            members[0].label(right.name)
            members[1].label(wrong.name)
            members[2].label(wrong.name)
    means = [
        [room.folded().crowd.aggregate(AnswerKind.LABEL).reliability(name).mean for name in ("ann", "bob")]
        for room in (golden, plain)
    ]
    golden.close()
    plain.close()
    assert means[0][0] > 0.8
    assert means[0][1] < 0.2
    assert means[1][1] > 0.5
    assert not any("gold" in field or "optimal_actions" in field for field in Decision.__struct_fields__)


def test_naming_another_optimum_costs_no_reliability_where_the_solver_knows(tmp_path: Path) -> None:
    knows, guesses = (room_of(tmp_path / name, solver=solver) for name, solver in (("k", True), ("g", False)))
    for room in (knows, guesses):
        room.create()
        members = room.members("ann", "bob", "cat")
        for _ in range(80):
            best = optimal(room.asked.view) or (0,)
            for member, place in zip(members, (0, 0, -1), strict=True):
                member.label(Action(best[place]).name)
    means = [
        room.folded().crowd.aggregate(AnswerKind.LABEL).reliability("cat").mean for room in (knows, guesses)
    ]
    knows.close()
    guesses.close()
    assert means[0] > 0.9
    assert means[1] < means[0]


def test_the_crowd_sees_the_end(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    (ann,) = crowd_room.members("ann")
    crowd_room.operate("stop")
    assert crowd_room.asked.phase == "finished"
    assert ann.join().rights == ()
    assert [row.kind for row in crowd_room.crowd_rows()][-1] == "finished"


def test_whoever_comes_back_after_the_end_is_not_counted_in(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    (ann,) = crowd_room.members("ann")
    crowd_room.operate("stop")
    ann.bus.close()
    crowd_room.settle()
    rows = len(crowd_room.crowd_rows())
    crowd_room.watcher.announce(CROWD_KEYS.present("s1", "ann"))
    crowd_room.settle()
    assert len(crowd_room.crowd_rows()) == rows
    assert crowd_room.folded().crowd.members == set()


def test_only_the_sessions_it_was_given_have_a_crowd(tmp_path: Path) -> None:
    room = room_of(tmp_path, sessions=("s2",))
    room.create()
    refusal = room.refused(CROWD_KEYS.join("s1", "ann"), Join(session="s1", teacher="ann"))
    room.close()
    assert refusal.code == "unknown-session"


@pytest.mark.parametrize(
    "wrong", [{"crowd_deployment": "local"}, {"gold_share": 1.5}, {"name": "A"}, {"sessions": ("S 1",)}]
)
def test_a_configuration_that_cannot_be_is_refused(tmp_path: Path, wrong: dict[str, Any]) -> None:
    with pytest.raises((ParameterError, ValueError)):
        AggregatorConfig(tmp_path, **wrong)


def test_an_acknowledgement_names_the_life_of_the_aggregator(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    ann, _ = crowd_room.members("ann", "bob")
    message = ann.message(crowd_room.asked, action="UP")
    reply = decode(ann.send(message).payload, Acknowledgement)
    assert (reply.epoch, reply.answer_id) == (crowd_room.crowd_shard.epoch, message.answer_id)
    assert msgspec.structs.replace(crowd_room.asked).epoch == reply.epoch
