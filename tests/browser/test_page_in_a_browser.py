"""The teaching page in a real Chromium, used as a person would (ring 3)."""

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import SimpleQueue

import pytest

from protocol.codec import decode
from protocol.keys import Keys
from protocol.messages import Step, WindowSpec
from services.client import join
from services.gym.world import described
from tests.browser.chromium import Chromium, Tab, chromium, program
from tests.browser.lesson import Lesson, lesson

pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(program() is None, reason="no Chromium is installed"),
]
PHONE = (390, 844)
SHOWN = "document.querySelector('.teach')?.dataset.shown"
FATE = "document.querySelector('.fate').dataset.state"
MESSAGE = "!!document.getElementById('message')"
SAVED = f"{FATE} === 'saved'"
KEPT = "Object.keys(localStorage).filter((key) => key.startsWith('sfid.out.')).length"
EARLY = WindowSpec(mode="early", span_ms=60_000)
RESUMED_S = 2.0
EXPECTED = re.compile("INTERNET_DISCONNECTED|CONNECTION_REFUSED")
"""What a browser says when a test took the network away, or killed the gateway."""

Open = Callable[..., Tab]


@pytest.fixture(scope="module")
def class_(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lesson]:
    with lesson(tmp_path_factory.mktemp("lesson")) as running:
        yield running


@pytest.fixture(scope="module")
def browser() -> Iterator[Chromium]:
    with chromium() as running:
        yield running


@pytest.fixture
def open_tab(browser: Chromium) -> Iterator[Open]:
    """Open tabs; at the end no tab may have seen an exception or a breach of the content policy."""
    tabs: list[Tab] = []

    def opened(url: str, person: str | None = None, *, phone: bool = False) -> Tab:
        tab = browser.tab(person or browser.person(), PHONE if phone else (1280, 800), touch=phone)
        tabs.append(tab)
        tab.open(url)
        return tab

    yield opened
    complaints = [line for tab in tabs for line in tab.complaints() if not EXPECTED.search(line)]
    for tab in tabs:
        tab.close()
    assert complaints == []


def shown(tab: Tab) -> int:
    """Wait until a decision that asks is on screen and return its number."""
    return int(tab.wait(SHOWN).rpartition("/")[2])


def next_shown(tab: Tab, before: int) -> int:
    tab.wait(f"({SHOWN} ?? '').split('/').pop() === '{before + 1}'")
    return before + 1


def totals(class_: Lesson, session: str) -> tuple[int, int]:
    labels = class_.report(session).labels
    return labels.submitted, labels.applied


def test_arrow_keys_teach_and_every_answer_is_told_to_be_saved(class_: Lesson, open_tab: Open) -> None:
    session = class_.session()
    tab = open_tab(class_.link(session))
    number = shown(tab)
    for key in ("ArrowUp", "h", "d", " "):
        tab.key(key)
        tab.wait(SAVED)
        number = next_shown(tab, number)
    assert tab.text(".fate").endswith("Nothing to say: saved")
    assert totals(class_, session) == (3, 3)  # nothing to say is no answer to learn from
    assert tab.run(KEPT) == 0


def test_a_held_key_does_not_run_into_the_next_decision(class_: Lesson, open_tab: Open) -> None:
    session = class_.session()
    tab = open_tab(class_.link(session))
    number = shown(tab)
    tab.key("ArrowUp", up=False)
    next_shown(tab, number)
    for _ in range(20):
        tab.key("ArrowUp", repeat=True, up=False)
    assert tab.run("document.querySelector('.teach').classList.contains('open')") is True
    assert totals(class_, session) == (1, 1)


def test_a_second_press_for_the_same_decision_is_told_to_be_one_too_many(
    class_: Lesson, open_tab: Open
) -> None:
    session = class_.session(window=EARLY, teachers_min=1)
    other = open_tab(class_.link(session, "bea"))
    shown(other)
    tab = open_tab(class_.link(session))
    shown(tab)
    tab.run("document.querySelector('[data-input=UP]').focus()")
    tab.key("Enter")
    tab.wait(SAVED)
    tab.click("[data-input=LEFT]")
    tab.wait(f"{FATE} === 'hint'")
    assert tab.text(".fate").endswith("This one has your answer.")
    assert totals(class_, session)[0] == 1


def test_fingers_tap_and_swipe_on_a_phone(class_: Lesson, open_tab: Open) -> None:
    session = class_.session()
    tab = open_tab(class_.link(session), phone=True)
    number = shown(tab)
    tab.tap("[data-input=LEFT]")
    tab.wait(SAVED)
    number = next_shown(tab, number)
    tab.swipe(".frame", 0, -80)
    tab.wait("document.querySelector('.fate').innerText.includes('Up: saved')")
    next_shown(tab, number)
    assert totals(class_, session) == (2, 2)
    overflow = "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
    assert tab.run(overflow) == list(PHONE)
    small = tab.run(
        "[...document.querySelectorAll('.pad button')]"
        ".filter((button) => button.getBoundingClientRect().height < 44).length"
    )
    assert small == 0


@pytest.mark.parametrize("size", [(390, 844), (360, 640), (320, 568), (844, 390), (768, 1024), (1024, 640)])
def test_board_and_buttons_fit_on_every_screen_without_scrolling(
    class_: Lesson, browser: Chromium, size: tuple[int, int]
) -> None:
    tab = browser.tab(browser.person(), size, touch=True)
    tab.open(class_.link(class_.session(window=EARLY)))
    shown(tab)
    boxes = tab.run(
        "[...document.querySelectorAll('#board, .fate, .asks, .pad button')]"
        ".map((one) => one.getBoundingClientRect()).map((box) => [box.left, box.top, box.right, box.bottom])"
    )
    tab.close()
    assert len(boxes) == 8
    assert all(
        0 <= left < right <= size[0] and 0 <= top < bottom <= size[1] for left, top, right, bottom in boxes
    )
    assert all(right - left >= 44 and bottom - top >= 44 for left, top, right, bottom in boxes[2:7])
    assert boxes[0][2] - boxes[0][0] >= 150


def test_a_reload_goes_on_at_the_same_decision_under_the_same_name(class_: Lesson, open_tab: Open) -> None:
    session = class_.session()
    tab = open_tab(class_.link(session, None))
    number = shown(tab)
    tab.key("ArrowUp")
    number = next_shown(tab, number)
    name = tab.run("document.documentElement.dataset.who")
    assert tab.run("location.hash") == ""  # the token has left the address bar
    began = time.monotonic()
    tab.run("window.before = true")
    tab.reload()
    tab.wait(f"!window.before && {SHOWN}")
    assert time.monotonic() - began < RESUMED_S
    assert shown(tab) == number
    assert tab.run("document.documentElement.dataset.who") == name
    assert class_.report(session).summary.teachers == (name,)


def test_an_answer_already_given_is_not_given_again_after_a_reload(class_: Lesson, open_tab: Open) -> None:
    session = class_.session(window=EARLY)
    shown(open_tab(class_.link(session, "bea")))
    tab = open_tab(class_.link(session))
    shown(tab)
    tab.key("ArrowUp")
    tab.wait(SAVED)
    tab.run("window.before = true")
    tab.reload()
    tab.wait(f"!window.before && {SHOWN}")
    tab.key("ArrowDown")
    tab.wait(f"{FATE} === 'hint'")
    assert totals(class_, session)[0] == 1


def test_without_network_an_answer_is_kept_and_sent_when_it_is_back(class_: Lesson, open_tab: Open) -> None:
    session = class_.session()
    tab = open_tab(class_.link(session))
    number = shown(tab)
    tab.network(on=False)
    tab.wait("document.getElementById('net').dataset.state === 'offline'")
    tab.key("ArrowUp")
    tab.wait(f"{FATE} === 'waiting'")
    assert tab.run(KEPT) == 1
    assert totals(class_, session) == (0, 0)
    began = time.monotonic()
    tab.network(on=True)
    tab.wait("document.querySelector('.fate').innerText.includes('Up: saved')")
    assert time.monotonic() - began < RESUMED_S
    next_shown(tab, number)
    assert totals(class_, session) == (1, 1)
    assert tab.run(KEPT) == 0


def test_an_answer_kept_without_network_survives_the_closing_of_the_page(
    class_: Lesson, browser: Chromium, open_tab: Open
) -> None:
    session = class_.session()
    person = browser.person()
    tab = open_tab(class_.link(session), person)
    number = shown(tab)
    tab.network(on=False)
    tab.wait("document.getElementById('net').dataset.state === 'offline'")
    tab.key("ArrowUp")
    tab.wait(f"{FATE} === 'waiting'")
    tab.open("about:blank")
    again = open_tab(class_.url, person)  # no token in this address: the browser has kept it
    next_shown(again, number)
    assert totals(class_, session) == (1, 1)
    assert again.run(KEPT) == 0


def test_an_answer_given_while_the_gateway_is_dead_is_saved_when_it_lives_again(
    class_: Lesson, open_tab: Open
) -> None:
    session = class_.session()
    tab = open_tab(class_.link(session))
    number = shown(tab)
    class_.kill_gateway()
    tab.wait("document.getElementById('net').dataset.state !== 'online'")
    tab.key("ArrowUp")
    tab.wait(f"{FATE} === 'waiting'")
    tab.wait("document.querySelector('.fate').innerText.includes('Up: saved')", 30.0)
    next_shown(tab, number)
    assert totals(class_, session) == (1, 1)
    assert tab.run(KEPT) == 0


def test_two_people_teach_at_once_and_each_is_counted(class_: Lesson, open_tab: Open) -> None:
    session = class_.session(window=EARLY, teachers_min=2)
    link = class_.link(session, None, people=2)
    ann, bea = open_tab(link), open_tab(link, phone=True)
    number = shown(ann)
    assert shown(bea) == number
    ann.key("ArrowUp")
    ann.wait(SAVED)
    assert ann.text(".fate").endswith("Up: saved. Waiting for the others")
    bea.tap("[data-input=UP]")
    assert next_shown(ann, number) == next_shown(bea, number)
    assert totals(class_, session) == (2, 2)
    third = open_tab(link)
    third.wait(MESSAGE)
    assert "used by all it was for" in third.text("#message")


def test_a_page_a_script_and_a_program_of_ones_own_teach_one_session_at_once(
    class_: Lesson, open_tab: Open, tmp_path: Path
) -> None:
    session = class_.session(window=EARLY, teachers_min=3)
    steps: SimpleQueue[bytes] = SimpleQueue()
    class_.bus.subscribe(Keys("local").measures(session), lambda received: steps.put(received.payload))
    tab = open_tab(class_.link(session, "ann"))
    command = [sys.executable, "-P", "-m", "services.cli.main", "teach", "scripted", "--name", "cyd"]
    script = subprocess.Popen(
        [*command, "--connect", class_.endpoint, "--session", session], stderr=subprocess.DEVNULL
    )
    try:
        with join(class_.endpoint, session, "bob", outbox=tmp_path / "bob.sqlite") as teaching:
            teaching.answer(next(teaching.decisions()), action="LEFT")
            shown(tab)
            tab.key("ArrowDown")
            tab.wait(f"{FATE} !== 'none'")
            step = decode(steps.get(timeout=20), Step)
    finally:
        script.terminate()
        script.wait(20)
    said = {one.teacher: (one.kind, one.action) for one in step.said}
    assert said["ann"] == ("label", "DOWN")
    assert said["bob"] == ("label", "LEFT")
    assert set(said) == {"ann", "bob", "cyd"}


def test_a_second_tab_takes_over_and_the_first_can_take_back(
    class_: Lesson, browser: Chromium, open_tab: Open
) -> None:
    session = class_.session()
    person = browser.person()
    first = open_tab(class_.link(session), person)
    number = shown(first)
    second = open_tab(class_.url, person)
    assert shown(second) == number
    first.wait(MESSAGE)
    assert "You went on in another tab" in first.text("#message")
    first.key("ArrowUp")
    assert totals(class_, session) == (0, 0)
    first.front()
    first.click("#again")
    assert shown(first) == number
    second.wait(MESSAGE)
    assert class_.report(session).summary.teachers == ("ann",)


def test_rewards_are_asked_for_with_the_move_that_they_judge(class_: Lesson, open_tab: Open) -> None:
    session = class_.session(method="reward")
    tab = open_tab(class_.link(session))
    number = shown(tab)
    assert re.fullmatch(r"It went (left|right|up|down)\. A good move\?", tab.text("#asks"))
    assert tab.run("document.querySelectorAll('.arrow.did').length") == 1
    tab.click("[data-input=good]")
    tab.wait("document.querySelector('.fate').innerText.includes('Good move: saved')")
    number = next_shown(tab, number)
    tab.key("-")
    tab.wait("document.querySelector('.fate').innerText.includes('Bad move: saved')")
    next_shown(tab, number)
    assert totals(class_, session) == (2, 2)


def test_guidance_is_given_before_the_move_and_a_reward_or_an_undo_after_it(
    class_: Lesson, open_tab: Open
) -> None:
    session = class_.session(method="guidance")
    tab = open_tab(class_.link(session))
    tab.wait(f"{SHOWN}?.includes('/guidance/')")
    assert tab.text("#asks") == "Which way is worth trying?"
    tab.key("ArrowUp")
    tab.wait(f"{SHOWN}.includes('/reward/')")
    assert "Up: saved" in tab.text(".fate")
    tab.click("[data-input=undo]")
    tab.wait("document.querySelector('.fate').innerText.includes('Take it back: saved')")
    assert class_.report(session).labels.submitted == 2


def test_a_mistake_is_marked_with_what_would_have_been_right(class_: Lesson, open_tab: Open) -> None:
    session = class_.session(method="marks")
    tab = open_tab(class_.link(session))
    number = shown(tab)
    assert tab.text("#asks").endswith("A mistake? Which way instead?")
    tab.click("[data-input=DOWN]")
    tab.wait("document.querySelector('.fate').innerText.includes('Down instead: saved')")
    next_shown(tab, number)
    assert totals(class_, session) == (1, 1)


def test_an_answer_after_the_window_is_told_to_be_too_late(class_: Lesson, open_tab: Open) -> None:
    session = class_.session(window=WindowSpec(mode="full", span_ms=700))
    tab = open_tab(class_.link(session))
    shown(tab)
    assert tab.run("document.querySelector('.teach').classList.contains('timed')") is True
    tab.network(on=False)
    tab.wait("document.getElementById('net').dataset.state === 'offline'")
    decision = class_.report(session).summary.decision
    tab.key("ArrowUp")
    until = time.monotonic() + 10
    while class_.report(session).summary.decision <= decision + 1 and time.monotonic() < until:
        tab.run("new Promise((done) => setTimeout(done, 100))")
    tab.network(on=True)
    tab.wait(f"{FATE} === 'too_late'")
    assert "too late to count, but saved" in tab.text(".fate")
    labels = class_.report(session).labels
    assert (labels.submitted, labels.applied, labels.late + labels.superseded) == (1, 0, 1)


def test_a_withdrawn_link_is_explained(class_: Lesson, open_tab: Open) -> None:
    session = class_.session()
    tab = open_tab(class_.link(session))
    shown(tab)
    class_.revoke(session)
    tab.wait(MESSAGE)
    assert "This link has been withdrawn: ask for a new one." in tab.text("#message")


def test_without_a_link_the_page_says_what_is_needed(class_: Lesson, open_tab: Open) -> None:
    tab = open_tab(class_.url)
    tab.wait(MESSAGE)
    assert "A link is needed" in tab.text("#message")


def test_a_screen_reader_hears_the_state_in_words_and_every_button_has_a_name(
    class_: Lesson, open_tab: Open
) -> None:
    session = class_.session()
    tab = open_tab(class_.link(session))
    shown(tab)
    words = tab.wait(
        "document.getElementById('live').textContent.includes('Around the agent') "
        "&& document.getElementById('live').textContent"
    )
    assert words.startswith("Which way would you go?")
    assert "1 boxes in place" in words
    tab.wire.call("Accessibility.enable")
    nodes = tab.wire.call("Accessibility.getFullAXTree")["nodes"]
    names = [
        (node["role"]["value"], node.get("name", {}).get("value", ""))
        for node in nodes
        if not node["ignored"] and node["role"]["value"] in {"button", "image"}
    ]
    assert [name for role, name in names if role == "button"] == [
        "Up", "Left", "Right", "Down", "Nothing to say this time",
    ]  # fmt: skip
    assert [name.split(":")[0] for role, name in names if role == "image"] == ["Around the agent"]


def test_nothing_moves_for_people_who_ask_for_that(class_: Lesson, open_tab: Open) -> None:
    tab = open_tab(class_.link(class_.session()))
    tab.media(**{"prefers-reduced-motion": "reduce"})
    shown(tab)
    assert tab.run("getComputedStyle(document.querySelector('.piece')).transitionDuration") == "0s"
    tab.media(**{"prefers-reduced-motion": "no-preference"})
    assert tab.run("getComputedStyle(document.querySelector('.piece')).transitionDuration") == "0.14s"


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_text_stands_out_from_its_ground(class_: Lesson, open_tab: Open, scheme: str) -> None:
    tab = open_tab(class_.link(class_.session()))
    tab.media(**{"prefers-color-scheme": scheme})
    shown(tab)
    names = ["--ink", "--soft", "--good", "--late", "--bad"]
    colours = tab.run(
        "(() => { const style = getComputedStyle(document.documentElement);"
        " const canvas = document.createElement('canvas').getContext('2d');"
        " const rgb = (name) => { canvas.fillStyle = style.getPropertyValue(name);"
        " canvas.fillRect(0, 0, 1, 1); return [...canvas.getImageData(0, 0, 1, 1).data].slice(0, 3); };"
        f" return {json.dumps([*names, '--bg', '--panel'])}.map(rgb); }})()"
    )
    luminances = [_luminance(colour) for colour in colours]
    for text in luminances[: len(names)]:
        for ground in luminances[len(names) :]:
            assert (max(text, ground) + 0.05) / (min(text, ground) + 0.05) >= 4.5


def _luminance(colour: list[int]) -> float:
    """The relative luminance of WCAG 2."""
    red, green, blue = (
        value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
        for value in (part / 255 for part in colour)
    )
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def test_another_world_is_shown_as_text_and_taught_by_buttons_and_numbers(
    class_: Lesson, open_tab: Open
) -> None:
    ride = described("Taxi-v4", {}, starts="1")
    session = class_.session(world=ride, episodes=1)
    tab = open_tab(class_.link(session))
    decision = shown(tab)
    asked, text = (
        "document.getElementById('asks').textContent",
        "document.getElementById('board').textContent",
    )
    assert tab.run(asked) == "What would you do?"
    assert re.search(r"[\[({<].[\])}>]", tab.run(text))
    tab.click("[data-input=PICKUP]")
    decision = next_shown(tab, decision)
    tab.key("1")
    next_shown(tab, decision)
    tab.wait(SAVED)
    assert totals(class_, session) == (2, 2)


def test_a_world_in_pictures_is_shown_as_the_picture_that_it_sent(class_: Lesson, open_tab: Open) -> None:
    room = described("sfid/Sokoban-v0", {}, render="picture")
    session = class_.session(world=room, episodes=1)
    tab = open_tab(class_.link(session))
    shown(tab)
    href = "document.querySelector('#board image').getAttribute('href')"
    tab.wait(f"{href}.startsWith('data:image/png')")
    tab.run(f"(window.seen = new Image()).src = {href}")
    assert tab.wait("window.seen.complete && window.seen.naturalWidth") == 112
