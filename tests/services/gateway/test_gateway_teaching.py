"""Browsers teach through the gateway: whose answers they are, what they hear, and that nothing is lost."""

import json
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from protocol.messages import Answer, Episode, SaidBy, Step
from services.gateway.config import GatewayConfig, GatewayError, place_of
from services.runtime.secret import SecretError, load_secrets
from services.screens import (
    FINISHED,
    Button,
    Field,
    FieldKind,
    Flow,
    FlowRefusal,
    Person,
    Screen,
    TeachOnly,
    Value,
)
from tests.services.gateway.gateway_house import Gateway, gateway
from tests.services.teachers.fake_learner import KEYS, ROOM, Code, drop, refuse

pytestmark = pytest.mark.real


@pytest.fixture
def house(tmp_path: Path) -> Iterator[Gateway]:
    with gateway(tmp_path, leave_ms=150) as running:
        yield running


def test_an_answer_arrives_under_the_name_in_the_token_and_is_acknowledged(house: Gateway) -> None:
    ann, decision = house.teacher("ann")
    answer_id = ann.answer(1, decision, response_ms=420)
    told = ann.next("answer")
    assert told == {"type": "answer", "id": answer_id, "state": "saved", "code": "accepted", "reason": ""}
    token = house.learner.answers[0].token
    assert house.learner.answers == [
        Answer(
            answer_id=bytes.fromhex(answer_id), session="s1", teacher="ann", epoch=1, decision=0, episode=0,
            step=0, state=b"room", kind="label", action="UP", response_ms=420, token=token,
        )
    ]  # fmt: skip
    assert token == house.learner.joins[0].token


def test_a_decision_is_told_with_what_the_page_draws_and_no_names(house: Gateway) -> None:
    ann, _ = house.teacher("ann")
    house.learner.go_on(decision=1, step=1, teachers=("ann", "bea"), teachers_present=2, remaining_ms=900)
    assert ann.next("decision", decision=1) == {
        "type": "decision", "session": "s1", "epoch": 1, "sequence": 2, "decision": 1, "episode": 0,
        "step": 1, "phase": "asking", "paused": False, "asked": "label", "state": b"room".hex(), "view": ROOM,
        "actions": ["LEFT", "RIGHT", "UP", "DOWN"], "action": None, "may_undo": False,
        "remaining_ms": 900,
        "window": {"mode": "early", "span_ms": 1000}, "teachers": 2, "episodes": 30, "optimal_steps": 1,
    }  # fmt: skip


def test_what_others_said_is_not_told(house: Gateway) -> None:
    ann, _ = house.teacher("ann")
    common: dict[str, Any] = {"session": "s1", "epoch": 1, "decision": 0, "episode": 0, "at_ns": 1}
    step = Step(
        **common, step=0, state=b"room", view=ROOM, action="LEFT", label="UP", h=-1.0, reward=0.0,
        td_error=0.1, td_error_shaped=0.1, outcome="solved", next_view=ROOM, values=(0.0,) * 4,
        said=(SaidBy(teacher="bea", kind="label", action="UP"),),
    )  # fmt: skip
    house.learner.publish(step)
    house.learner.publish(
        Episode(
            **common,
            steps=3,
            optimal_steps=1,
            abs_td_error=0.0,
            abs_td_error_shaped=0.0,
            discounted_return=0.0,
            discounted_env_return=0.0,
            inputs=1,
            agreements=0,
            outcome="solved",
        )
    )
    told = ann.next("episodes")
    assert not any("said" in frame or frame["type"] == "step" for frame in ann.frames)
    assert told["episodes"] == [{"episode": 0, "steps": 3, "optimal": 1, "outcome": "solved"}]


def test_an_answer_nobody_acknowledged_is_sent_again_with_the_same_bytes(house: Gateway) -> None:
    ann, decision = house.teacher("ann")
    house.learner.answer_replies = [drop, refuse("busy"), refuse("not-durable")]
    ann.answer(1, decision)
    assert ann.next("answer")["state"] == "retrying"
    assert ann.next("answer", state="saved")["code"] == "accepted"
    assert len(house.learner.payloads) == 4
    assert len(set(house.learner.payloads)) == 1


def test_an_answer_that_came_too_late_is_told_so(house: Gateway) -> None:
    ann, decision = house.teacher("ann")
    told = []
    codes: tuple[Code, ...] = ("superseded", "late", "rejected", "conflict")
    for number, code in enumerate(codes):
        house.learner.code = code
        ann.answer(number, decision)
        told.append(ann.next("answer"))
    assert [(frame["code"], frame["state"]) for frame in told] == [
        ("superseded", "too_late"), ("late", "too_late"), ("rejected", "rejected"), ("conflict", "rejected"),
    ]  # fmt: skip


def test_one_who_comes_again_sees_the_same_decision_at_once_and_joins_no_second_time(house: Gateway) -> None:
    token = house.token("ann")
    first = house.browser().hello(token)
    decision = first.next("decision")
    first.socket.close()
    again = house.browser().hello(token)
    assert again.next("decision") == decision
    again.answer(1, decision)
    assert again.next("answer")["state"] == "saved"
    assert [join.teacher for join in house.learner.joins] == ["ann"]


def test_one_who_leaves_is_gone_after_a_moment_and_comes_back(house: Gateway) -> None:
    token = house.token("ann")
    house.browser().hello(token).next("decision")
    watcher = house.learner.bus
    seen: list[bool] = []
    watcher.watch(KEYS.present("s1", "ann"), lambda presence: seen.append(presence.present))
    house.stack.close()
    house.status(lambda _: seen == [True, False])
    house.browser().hello(token).next("decision")
    house.status(lambda _: len(seen) == 3 and len(house.learner.joins) == 2)
    assert seen == [True, False, True]
    assert [join.teacher for join in house.learner.joins] == ["ann", "ann"]


def test_a_second_tab_takes_over_with_a_clear_word(house: Gateway) -> None:
    token = house.token("ann")
    first = house.browser().hello(token)
    decision = first.next("decision")
    second = house.browser().hello(token)
    assert first.next("refused") == {"type": "refused", "reason": "taken-over", "text": "", "final": True}
    assert first.closed() == 4409
    second.next("decision")
    second.answer(1, decision)
    assert second.next("answer")["state"] == "saved"


def test_everybody_joins_again_when_the_learner_has_been_restarted(house: Gateway) -> None:
    people = [house.teacher(name)[0] for name in ("ann", "bea", "cyd")]
    house.status(lambda _: len(house.learner.joins) == 3)
    house.learner.go_on(epoch=2)
    for person in people:
        person.next("decision", epoch=2)
    house.status(lambda _: len(house.learner.joins) == 6)
    assert sorted(join.teacher for join in house.learner.joins[3:]) == ["ann", "bea", "cyd"]


def test_an_invitation_becomes_a_name_of_ones_own_for_as_many_as_it_is_for(house: Gateway) -> None:
    link = house.invitation(people=2)
    people = [house.browser().hello(link, nonce=f"{number:032x}").next("you") for number in (1, 2)]
    again = house.browser().hello(link, nonce=f"{1:032x}").next("you")
    assert again["pseudonym"] == people[0]["pseudonym"] != people[1]["pseudonym"]
    own = house.browser().hello(people[0]["token"])
    assert own.next("you")["pseudonym"] == people[0]["pseudonym"]
    third = house.browser().hello(link, nonce=f"{3:032x}")
    assert third.next("refused")["reason"] == "invitation-full"
    house.refused(invitation_full=1)


def test_a_revoked_invitation_ends_the_lessons_of_all_who_used_it(house: Gateway) -> None:
    token_id = "c" * 16
    person = house.browser().hello(house.invitation(people=2, token_id=token_id))
    person.next("decision")
    other, _ = house.teacher("bea")
    house.revoke(token_id)
    assert person.next("refused")["reason"] == "revoked-token"
    assert person.closed() == 4401
    other.send("ping")
    other.next("pong")
    house.refused(revoked_token=1)


class Study:
    """Consent, teaching, one question, done."""

    def __init__(self) -> None:
        self.at: dict[str, int] = {}
        self.arrived: list[Mapping[str, str]] = []
        self.said: list[tuple[str, str, Mapping[str, Value]]] = []
        go = (Button("go", "Go on"), Button("stop", "Stop", fills=False))
        self.screens = (
            Screen("consent", "Consent", ("Text.",), (Field("agree", FieldKind.CHECK, "I agree"),), go),
            Screen("teach", session="s1", buttons=(Button("stop", "Stop", fills=False),)),
            Screen(
                "effort",
                fields=(
                    Field("demand", FieldKind.SCALE, "How hard?", high=20.0),
                    Field("why", FieldKind.TEXT, "Why?", required=False, length_max=10),
                    Field("hand", FieldKind.CHOICE, "Which hand?", choices=("left", "right")),
                ),
                buttons=go,
            ),
            Screen("done", code="C0DE"),
        )

    def arrive(self, person: Person, arrival: Mapping[str, str]) -> None:
        if arrival.get("PROLIFIC_PID") == "banned":
            raise FlowRefusal("you have taken part before")
        self.arrived.append(arrival)

    def screen(self, person: Person) -> Screen:
        return self.screens[self.at.get(person.pseudonym, 0)]

    def submit(self, person: Person, screen: str, button: str, values: Mapping[str, Value]) -> None:
        self.said.append((screen, button, values))
        self.at[person.pseudonym] = (
            len(self.screens) - 1 if button == "stop" else self.at.get(person.pseudonym, 0) + 1
        )

    def depart(self, person: Person) -> None:
        self.at.setdefault(person.pseudonym, 0)


def test_a_flow_leads_through_screens_around_the_lesson(tmp_path: Path) -> None:
    study = Study()
    flow: Flow = study
    with gateway(tmp_path, flow=flow) as house:
        ann = house.browser().hello(house.token("ann"), PROLIFIC_PID="P1", other="x")
        screen = ann.next("screen")["screen"]
        assert (screen["name"], screen["session"]) == ("consent", None)
        for wrong in ({}, {"agree": False}, {"agree": "yes"}, {"agree": True, "more": 1}):
            ann.send("submit", screen="consent", button="go", values=wrong)
            assert ann.next("refused")["reason"] == "fields"
        ann.send("submit", screen="consent", button=FINISHED, values={"agree": True})
        assert ann.next("refused")["reason"] == "fields"
        ann.send("submit", screen="consent", button="go", values={"agree": True})
        assert ann.next("screen")["screen"]["session"] == "s1"
        decision = ann.next("decision")
        ann.answer(1, decision)
        ann.next("answer", state="saved")
        house.learner.go_on(phase="finished")
        assert ann.next("screen")["screen"]["name"] == "effort"
        ann.send("submit", screen="teach", button="stop")  # pressed in the moment of change: not counted
        assert ann.next("screen")["screen"]["name"] == "effort"
        misfits: tuple[dict[str, Value], ...] = (
            {"demand": 21, "hand": "left"}, {"demand": 3, "hand": "none"}, {"demand": True, "hand": "left"},
            {"demand": 3, "hand": "left", "why": "x" * 11}, {"demand": 2**53, "hand": "left"},
        )  # fmt: skip
        ann.send("submit", screen="effort", button="go", values={"demand": 10**300})
        assert ann.next("refused")["reason"] == "malformed"
        for values in misfits:
            ann.send("submit", screen="effort", button="go", values=values)
            assert ann.next("refused")["reason"] == "fields"
        ann.send("submit", screen="effort", button="go", values={"demand": 3, "hand": "left", "why": ""})
        assert ann.next("screen")["screen"]["code"] == "C0DE"
        house.refused(fields=10, frame_malformed=1)
    assert study.arrived == [{"PROLIFIC_PID": "P1", "other": "x"}]
    assert study.said == [
        ("consent", "go", {"agree": True}),
        ("teach", FINISHED, {}),
        ("effort", "go", {"demand": 3, "why": "", "hand": "left"}),
    ]


class Timed(TeachOnly):
    """Teaching until somebody elsewhere says that the time is over."""

    def __init__(self) -> None:
        self.over = False
        self.departed: list[str] = []

    def screen(self, person: Person) -> Screen:
        return Screen("over", "Time is over") if self.over else Screen("teach", session=person.session)

    def depart(self, person: Person) -> None:
        self.departed.append(person.pseudonym)


def test_a_flow_goes_on_by_itself_and_hears_who_has_gone(tmp_path: Path) -> None:
    flow = Timed()
    with gateway(tmp_path, flow=flow, leave_ms=50) as house:
        ann, _ = house.teacher("ann")
        flow.over = True
        assert ann.next("screen")["screen"]["name"] == "over"
        ann.socket.close()
        house.status(lambda _: flow.departed == ["ann"])


class Broken(TeachOnly):
    """A flow with a mistake in it."""

    def submit(self, person: Person, screen: str, button: str, values: Mapping[str, Value]) -> None:
        raise ZeroDivisionError

    def screen(self, person: Person) -> Screen:
        return Screen("form", buttons=(Button("go", "Go"),))


def test_a_mistake_of_ours_is_counted_and_the_person_goes_on(tmp_path: Path) -> None:
    with gateway(tmp_path, flow=Broken()) as house:
        ann = house.browser().hello(house.token("ann"))
        ann.next("screen")
        ann.send("submit", screen="form", button="go")
        ann.send("ping")
        assert ann.next("pong") == {"type": "pong"}
        house.refused(fault=1)


def test_a_flow_can_refuse_a_person(tmp_path: Path) -> None:
    with gateway(tmp_path, flow=Study()) as house:
        ann = house.browser().hello(house.token("ann"), PROLIFIC_PID="banned")
        assert ann.next("refused")["text"] == "you have taken part before"
        assert ann.closed() == 4401
        house.refused(flow=1)


def test_the_status_tells_numbers_and_nobody(house: Gateway) -> None:
    ann, decision = house.teacher("ann")
    ann.answer(1, decision)
    ann.next("answer")
    found = house.status(lambda found: found["done"].get("saved") == 1 and found["people"] == 1)
    assert found["url"] == house.url
    assert {key: found[key] for key in ("rooms", "answers_open", "unreadable", "refused", "done")} == {
        "rooms": 1, "answers_open": 0, "unreadable": 0, "refused": {},
        "done": {"hellos": 1, "answers": 1, "saved": 1},
    }  # fmt: skip
    assert "ann" not in json.dumps(found)


def test_the_secret_is_made_once_and_is_its_owners_alone(tmp_path: Path) -> None:
    first = load_secrets(tmp_path / "gateway")
    assert load_secrets(tmp_path / "gateway") == first
    path = tmp_path / "gateway" / "secret"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    path.chmod(0o640)
    with pytest.raises(SecretError, match="chmod 600"):
        load_secrets(tmp_path / "gateway")


@pytest.mark.parametrize(
    "changes, reason",
    [
        ({"listen": "0.0.0.0:80"}, "nothing would be encrypted"),
        ({"listen": "192.168.1.5:7480"}, "nothing would be encrypted"),
        ({"listen": "example.org:7480"}, "nothing would be encrypted"),
        ({"listen": "0.0.0.0:80", "insecure_bind": True}, "give it as --url"),
        ({"listen": "nowhere"}, "is no address"),
        ({"listen": "127.0.0.1:99999"}, "is no address"),
        ({"url": "ftp://x"}, "no page address"),
        ({"url": "https://x/path"}, "no page address"),
        ({"tls_cert": Path("cert.pem")}, "both --tls-cert and --tls-key"),
        ({"tls_cert": Path("no.pem"), "tls_key": Path("no.key")}, "give a PEM pair"),
    ],
)
def test_an_open_or_unreadable_address_is_refused_in_one_line(
    tmp_path: Path, changes: dict[str, object], reason: str
) -> None:
    with pytest.raises(GatewayError, match=reason) as caught:
        place_of(GatewayConfig(tmp_path, **changes))  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "changes, address",
    [
        ({}, "http://127.0.0.1:7480"),
        ({"listen": "[::1]:80"}, "http://[::1]"),
        (
            {"listen": "0.0.0.0:80", "insecure_bind": True, "url": "https://Teach.example"},
            "https://teach.example",
        ),
        ({"url": "https://teach.example:8443/"}, "https://teach.example:8443"),
    ],
)
def test_people_are_given_the_address_that_they_can_reach(
    tmp_path: Path, changes: dict[str, object], address: str
) -> None:
    place = place_of(GatewayConfig(tmp_path, **changes))  # type: ignore[arg-type]
    assert place.address(place.port) == address
