"""The cards of all sessions: what a newcomer would take for something else."""

import msgspec
import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from protocol.messages import Decision, Episode
from services import tiles
from services.monitor import font
from services.monitor.overview import DOTTED, MUTED, STEPS, draw_overview, glance
from services.monitor.rows import Indexed, Moment, Picture
from services.monitor.session_view import SessionView
from tests.services.monitor.feeder import Lesson

ON_GOAL = "#####\n#+$ #\n#####"
OFF_GOAL = "#####\n#@$.#\n#####"


def opened(phase: str, view: str = OFF_GOAL) -> SessionView:
    """Return a session at its very first decision."""
    first = next(message for message in Lesson(episodes=30).messages() if isinstance(message, Decision))
    shown = SessionView(0.0)
    opening: Decision = msgspec.structs.replace(first, phase=phase, view=view)
    shown.take(opening, 10.0)
    return shown


def card(view: SessionView) -> Picture:
    return draw_overview([glance("monday", view, 11.0)], Moment(0))


def colours_of(picture: Picture) -> npt.NDArray[np.uint8]:
    assert isinstance(picture.image, Indexed)
    return picture.image.palette[picture.image.indexes]


def is_written(picture: Picture, text: str, scale: int = 1, colour: int = MUTED) -> bool:
    """Tell whether the words stand somewhere in the picture."""
    assert isinstance(picture.image, Indexed)
    canvas = np.zeros((font.HEIGHT * scale, font.width_of(text) * scale), np.uint8)
    font.write(canvas, text, (0, 0), 1, scale)
    inked = (picture.image.indexes == len(tiles.palette()) + colour).astype(np.uint8)
    return bool((sliding_window_view(inked, canvas.shape) == canvas).all(axis=(2, 3)).any())


def count(picture: Picture, letter: str) -> int:
    rgb = [int(tiles.COLOURS[letter][at : at + 2], 16) for at in (1, 3, 5)]
    return int((colours_of(picture) == rgb).all(axis=2).sum())


def test_a_session_that_has_not_begun_is_not_said_to_be_in_its_first_episode() -> None:
    waiting, going_on = card(opened("gathering")), card(opened("asking"))
    assert is_written(waiting, "not begun, 30 episodes")
    assert not is_written(waiting, "episode 1 of 30")
    assert is_written(going_on, "episode 1 of 30")
    unheard = card(SessionView(0.0))
    assert not is_written(unheard, "not begun")


def test_a_goal_below_the_agent_is_seen() -> None:
    picture, nothing = card(opened("asking", ON_GOAL)), card(opened("asking", "no board"))
    assert count(picture, "g") > count(nothing, "g"), "more than the key below the cards"
    assert count(picture, "r") > count(nothing, "r")


def test_a_box_on_its_goal_has_another_colour_than_any_box() -> None:
    home, away = (card(opened("asking", f"#####\n#@{box}#\n#####")) for box in ("* ", "$."))
    nothing = card(opened("asking", "no board"))
    assert count(home, "h") > count(nothing, "h") == count(away, "h")
    assert count(away, "w") > count(nothing, "w") == count(home, "w")


def test_the_colours_of_the_boards_are_told_below_the_cards() -> None:
    picture = card(opened("asking", "#######\n#     #\n#######".replace("     ", "@$.* ")))
    assert isinstance(picture.image, Indexed)
    last = picture.image.indexes[-16:]
    for letter in "rwgh":
        assert tiles.colour_number(letter) in last, letter


def test_beside_an_unsolved_episode_no_larger_number_is_called_the_fewest_and_the_dotted_line_is_told() -> (
    None
):
    last = next(message for message in Lesson(episodes=1).messages() if isinstance(message, Episode))
    for outcome, words in (("solved", "steps 12, fewest 9"), ("deadlock", "steps 12, unsolved")):
        view = opened("asking")
        assert not is_written(card(view), DOTTED, 2), "no line is drawn yet"
        assert is_written(card(view), "no episode done", colour=STEPS)
        view.take(msgspec.structs.replace(last, outcome=outcome, steps=12, optimal_steps=9), 10.0)
        assert is_written(card(view), words, colour=STEPS), words
        assert is_written(card(view), DOTTED, 2)
