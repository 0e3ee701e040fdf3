"""However an episode ends: the wire has a word for it, and every screen says it."""

import re
from pathlib import Path
from typing import get_args

from protocol.fields import OutcomeName
from services.monitor.status import ENDS
from services.teachers.panel import OUTCOMES
from sfid_core.outcome import Outcome

PAGE = Path(__file__).parents[2] / "services" / "gateway" / "page" / "teach.js"
WORDS = {outcome.word for outcome in Outcome}


def test_the_wire_has_a_word_for_every_outcome() -> None:
    assert set(get_args(OutcomeName)) == WORDS


def test_monitor_keyboard_and_page_say_every_outcome() -> None:
    (table,) = re.findall(r"^const OUTCOMES = \{(.*)\};$", PAGE.read_text("utf-8"), re.MULTILINE)
    assert set(ENDS) == set(OUTCOMES) == set(re.findall(r"(\w+): \"", table)) == WORDS


def test_nothing_follows_an_ending_of_the_world_and_something_a_cut() -> None:
    assert {outcome for outcome in Outcome if outcome.terminal} == {
        Outcome.SOLVED,
        Outcome.DEADLOCK,
        Outcome.FAILED,
    }
