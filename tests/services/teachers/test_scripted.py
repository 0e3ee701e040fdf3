import threading

import pytest

from protocol.messages import Answer, Decision, Refusal, Step
from services.client import Learnt, Opened
from services.runtime.memory_bus import MemoryBus, MemoryHub
from services.teachers.scripted import Said, Script, ScriptedConfig, ScriptedError, run
from sfid_core.learning.parameters import Value, parameters_of
from sfid_core.teaching.kernels import TeacherParameters
from tests.services.teachers.fake_learner import FakeLearner, decision, refuse

CORRIDOR = ("#######\n#. $ @#\n#######", "#######\n#. $@ #\n#######", "#######\n#.$@  #\n#######")


def script(answered: bool = False, seed: int = 0, delay_ms: int = 0, **faults: Value) -> Script:  # noqa: FBT001, FBT002 - reads well
    config = ScriptedConfig(
        "s1", seed=seed, delay_ms=delay_ms, parameters=parameters_of(TeacherParameters, faults, "teacher")
    )
    return Script(config, lambda _decision: answered)


def says(teacher: Script, asked: Decision) -> Said | None:
    teacher.hear(Opened(asked, 0), 0)
    return teacher.speak(0)


def step(number: int, next_view: str, **changes: object) -> Learnt:
    fields: dict[str, object] = {
        "session": "s1", "epoch": 1, "decision": number, "episode": 0, "step": number, "at_ns": 0,
        "state": b"", "view": "", "action": "LEFT", "h": 0.0, "reward": 0.0, "td_error": 0.0,
        "td_error_shaped": 0.0, "outcome": "running", "next_view": next_view, "values": (),
    }  # fmt: skip
    return Learnt(Step(**(fields | changes)))  # type: ignore[arg-type]


def test_a_label_is_the_solvers_action_for_the_view() -> None:
    asked = decision()
    assert says(script(), asked) == Said(asked, action="LEFT")


def test_a_teacher_who_always_errs_never_names_the_optimal_action() -> None:
    named = {
        said.action
        for number in range(50)
        if (said := says(script(label_error=1.0), decision(decision=number))) is not None
    }
    assert named == {"RIGHT", "UP", "DOWN"}


def test_silence_is_said_as_an_abstention() -> None:
    asked = decision()
    assert says(script(silence=1.0), asked) == Said(asked)


def test_the_same_seed_says_the_same_after_a_restart() -> None:
    asked = [decision(decision=number) for number in range(40)]
    first = script(seed=7, label_error=0.5, silence=0.3)
    whole = [says(first, one) for one in asked]
    second = script(seed=7, label_error=0.5, silence=0.3)
    assert [says(second, one) for one in asked[25:]] == whole[25:]


def test_actions_keep_their_names_whatever_their_order_on_the_wire() -> None:
    asked = decision(actions=("UP", "DOWN", "LEFT", "RIGHT"))
    assert says(script(), asked) == Said(asked, action="LEFT")


@pytest.mark.parametrize("action,after,reward", [("LEFT", CORRIDOR[1], 1.0), ("UP", CORRIDOR[0], -1.0)])
def test_a_reward_judges_the_action_in_the_state_before_it(action: str, after: str, reward: float) -> None:
    teacher = script()
    assert says(teacher, decision(phase="executing", asked="reward", action=action, view=CORRIDOR[0])) is None
    asked = decision(sequence=2, asked="reward", action=action, view=after)
    assert says(teacher, asked) == Said(asked, reward=reward)


def test_a_reward_falls_back_on_what_the_step_before_led_to() -> None:
    teacher = script()
    teacher.hear(step(4, CORRIDOR[1]), 0)
    asked = decision(decision=5, asked="reward", action="LEFT", view=CORRIDOR[2])
    assert says(teacher, asked) == Said(asked, reward=1.0)


@pytest.mark.parametrize("heard", [None, step(3, CORRIDOR[1]), step(4, CORRIDOR[1], outcome="solved")])
def test_a_teacher_who_has_not_seen_the_state_before_abstains(heard: Learnt | None) -> None:
    teacher = script()
    if heard is not None:
        teacher.hear(heard, 0)
    asked = decision(decision=5, asked="reward", action="LEFT", view=CORRIDOR[2])
    assert says(teacher, asked) == Said(asked)


def test_a_kind_of_answer_that_a_script_has_no_opinion_on_is_an_abstention() -> None:
    asked = decision(asked="mistake")
    assert says(script(), asked) == Said(asked)


def test_guidance_points_at_the_solvers_action_and_others() -> None:
    asked = decision(asked="guidance")
    assert says(script(guidance_width=1), asked) == Said(asked, guidance=("LEFT",))
    said = says(script(guidance_width=2), asked)
    assert said is not None
    assert "LEFT" in said.guidance
    assert len(said.guidance) == 2


def test_an_answer_to_guidance_leaves_the_reward_of_the_same_decision_open() -> None:
    teacher = script()
    assert says(teacher, decision(asked="guidance", view=CORRIDOR[2])) is not None
    judged = decision(asked="reward", action="LEFT", view=CORRIDOR[2])
    assert says(teacher, judged) == Said(judged, reward=1.0)


def test_what_was_answered_already_is_not_answered_again() -> None:
    assert says(script(answered=True), decision()) is None


def test_thinking_takes_its_time_and_a_closed_window_ends_it() -> None:
    teacher = script(delay_ms=100)
    asked = decision()
    teacher.hear(Opened(asked, 0), 0)
    announced_again = decision(sequence=2, remaining_ms=900)
    teacher.hear(Opened(announced_again, 0), 60_000_000)
    said = [teacher.speak(99_999_999), teacher.speak(100_000_000), teacher.speak(200_000_000)]
    teacher.hear(Opened(decision(decision=1), 0), 0)
    teacher.hear(Opened(decision(decision=1, phase="executing"), 0), 0)
    assert said == [None, Said(announced_again, action="LEFT"), None]
    assert teacher.speak(10**12) is None


def test_a_level_beyond_the_solver_is_one_line() -> None:
    rows = ["#" * 22, *["#" + " " * 20 + "#"] * 12, "#" + "$." * 10 + "#", "#@" + " " * 19 + "#", "#" * 22]
    with pytest.raises(ScriptedError, match=r"^the level is beyond the exact solver .*choose a smaller one$"):
        says(script(), decision(view="\n".join(rows)))


def test_a_view_of_another_world_is_one_line() -> None:
    mend = "name it with the --gym and --gym-option that the session was created with"
    with pytest.raises(ScriptedError, match=rf"^the session's world is no Sokoban \(.*\): {mend}, or let "):
        says(script(), decision(view="a chess board"))


@pytest.mark.parametrize("best", [{}, {b"room": (5,)}])
def test_a_state_of_another_environment_is_one_line(best: dict[bytes, tuple[int, ...]]) -> None:
    teacher = Script(ScriptedConfig("s1"), lambda _decision: False, best=best)
    with pytest.raises(ScriptedError, match=r"teach with the --gym and --gym-option that the session was"):
        says(teacher, decision())


def taught(learner: FakeLearner, hub: MemoryHub, **settings: object) -> None:
    config = ScriptedConfig("s1", **settings)  # type: ignore[arg-type]
    ready: list[bool] = []
    run(config, MemoryBus(hub), lambda: ready.append(True), threading.Event())
    assert ready == [True]


def walk(learner: FakeLearner, decisions: int) -> None:
    """Open one decision after another, then finish."""

    def on_answer(answer: Answer) -> None:
        learner.go_on(phase="executing")
        if answer.decision + 1 == decisions:
            learner.go_on(phase="finished")
        else:
            learner.go_on(phase="asking", decision=answer.decision + 1)

    learner.on_answer = on_answer


def test_a_scripted_teacher_teaches_until_the_session_is_finished() -> None:
    hub = MemoryHub(inline=True)
    learner = FakeLearner(MemoryBus(hub))
    walk(learner, 20)
    taught(learner, hub)
    assert [(answer.decision, answer.kind, answer.action) for answer in learner.answers] == [
        (number, "label", "LEFT") for number in range(20)
    ]


def test_a_scripted_teacher_sends_abstentions_so_that_the_quorum_closes() -> None:
    hub = MemoryHub(inline=True)
    learner = FakeLearner(MemoryBus(hub))
    walk(learner, 3)
    taught(learner, hub, parameters=TeacherParameters(silence=1.0))
    assert [(answer.kind, answer.action) for answer in learner.answers] == [("abstain", None)] * 3


def test_a_learner_that_fails_once_gets_the_same_answer_again() -> None:
    hub = MemoryHub(inline=True)
    learner = FakeLearner(MemoryBus(hub))
    learner.answer_replies = [refuse("busy"), refuse("not-durable")]
    walk(learner, 2)
    taught(learner, hub)
    assert [answer.decision for answer in learner.answers] == [0, 0, 0, 1]
    assert len(set(learner.payloads)) == 2


def test_a_denied_teacher_ends_with_the_reason() -> None:
    hub = MemoryHub(inline=True)
    learner = FakeLearner(MemoryBus(hub))
    learner.join_refusal = Refusal(code="denied", reason="no token")
    with pytest.raises(ScriptedError, match=r"session 's1': no token \(denied\)"):
        taught(learner, hub)


def test_a_wait_for_the_session_and_a_stubborn_answer_are_logged_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    hub = MemoryHub(inline=True)
    learner = FakeLearner(MemoryBus(hub))
    learner.join_refusal = Refusal(code="unknown-session", reason="no session s1 here")
    learner.on_join = lambda join_number: setattr(learner, "join_refusal", None) if join_number == 2 else None
    learner.answer_replies = [refuse("busy", "too much to do")] * 3
    walk(learner, 1)
    with caplog.at_level("INFO", "sfid.teacher"):
        taught(learner, hub)
    assert caplog.messages == [
        "session s1: waiting, no session s1 here",
        "session s1: joined",
        "session s1: answer sent 2 times: too much to do",
        "session s1: 1 answer saved",
    ]


def test_a_teacher_told_to_stop_leaves() -> None:
    stop, told = threading.Event(), []

    def ready() -> None:
        told.append("ready")
        stop.set()

    run(ScriptedConfig("s1"), MemoryBus(MemoryHub(inline=True)), ready, stop)
    assert told == ["ready"]
