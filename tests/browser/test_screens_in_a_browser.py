"""Screens around the lesson, in a real Chromium: what a study shows before and after teaching (ring 3)."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from services.screens import Button, Field, FieldKind, Person, Screen, TeachOnly, Value
from tests.browser.chromium import Chromium, Tab, chromium, program
from tests.services.gateway.gateway_house import gateway

pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(program() is None, reason="no Chromium is installed"),
]
HOSTILE = "<img src=x onerror=alert(1)>"
CONSENT = Screen(
    "consent",
    "Taking part",
    ("You teach an agent.", HOSTILE),
    (Field("agree", FieldKind.CHECK, "I want to take part"),),
    (Button("go", "Begin"),),
)
EFFORT = Screen(
    "effort",
    "How was it?",
    fields=(
        Field("demand", FieldKind.SCALE, "How demanding?", high=20, low_label="low", high_label="high"),
        Field("hand", FieldKind.CHOICE, "Which hand?", choices=("left", "right")),
        Field("age", FieldKind.NUMBER, "Your age", high=120),
        Field("more", FieldKind.TEXT, "Anything else?", required=False),
    ),
    buttons=(Button("send", "Send"), Button("back", "Without answers", fills=False)),
)
DONE = Screen("done", "Thank you", code="C0DE-17", link="https://study.example/done?cc=17", link_label="Back")


class Study(TeachOnly):
    """Consent, the lesson with a way out, a questionnaire, a code."""

    def __init__(self) -> None:
        teach = Screen("teach", session="s1", buttons=(Button("stop", "Stop", fills=False),))
        self.screens = (CONSENT, teach, EFFORT, DONE)
        self.at = 0
        self.said: list[tuple[str, str, Mapping[str, Value]]] = []

    def screen(self, person: Person) -> Screen:
        return self.screens[self.at]

    def submit(self, person: Person, screen: str, button: str, values: Mapping[str, Value]) -> None:
        self.said.append((screen, button, values))
        self.at += 1


@pytest.fixture(scope="module")
def browser() -> Iterator[Chromium]:
    with chromium() as running:
        yield running


def title(tab: Tab, text: str) -> None:
    tab.wait(f"document.querySelector('main h1')?.textContent === {text!r}")


def test_a_person_walks_through_consent_lesson_questions_and_code(browser: Chromium, tmp_path: Path) -> None:
    study = Study()
    with gateway(tmp_path, flow=study) as house:
        tab = browser.tab(browser.person(), (390, 844), touch=True)
        tab.open(f"{house.url}/?PROLIFIC_PID=P1#t={house.token('ann')}")
        title(tab, "Taking part")
        assert HOSTILE in tab.text("main")  # shown as text, not made into an element
        tab.tap("[data-button=go]")
        tab.wait("document.querySelector('.problem').textContent === 'One answer is still missing.'")
        tab.tap("[data-field=agree] input")
        tab.wait("document.querySelector('.problem').textContent === ''")
        tab.tap("[data-button=go]")
        tab.wait("document.querySelector('.teach')?.dataset.shown")
        tab.tap("[data-input=UP]")
        tab.wait("document.querySelector('.fate').dataset.state === 'saved'")
        tab.tap("[data-button=stop]")
        title(tab, "How was it?")
        tab.tap("[data-button=send]")
        tab.wait("document.querySelector('.problem').textContent === '3 answers are still missing.'")
        tab.run("document.getElementById('field-demand').focus()")
        tab.key("ArrowRight")
        tab.wait("document.querySelector('.problem').textContent === '2 answers are still missing.'")
        tab.tap("[data-field=hand] label:nth-of-type(2) input")
        tab.wait("document.querySelector('.problem').textContent === 'One answer is still missing.'")
        tab.run("document.getElementById('field-age').focus()")
        tab.key("3")
        tab.key("7")
        tab.tap("[data-button=send]")
        title(tab, "Thank you")
        assert tab.text(".code code") == "C0DE-17"
        link = "[document.querySelector('.go').href, document.querySelector('.go').rel]"
        assert tab.run(link) == ["https://study.example/done?cc=17", "noreferrer"]
        tab.reload()
        title(tab, "Thank you")
        assert tab.complaints() == []
        tab.close()
    assert study.said == [
        ("consent", "go", {"agree": True}),
        ("teach", "stop", {}),
        ("effort", "send", {"demand": 11, "hand": "right", "age": 37, "more": None}),
    ]
    assert [answer.action for answer in house.learner.answers] == ["UP"]
