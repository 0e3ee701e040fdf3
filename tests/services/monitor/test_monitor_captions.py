"""What stands below a doubtful state: its number, and how often which move was named there."""

import numpy as np

from services import tiles
from services.monitor import font
from services.monitor.doubt_pictures import COLUMNS, draw_doubtful
from services.monitor.doubts import Doubts
from services.monitor.rows import Moment
from services.monitor.scene import read_view
from services.tiles import Indexes
from tests.services.monitor.test_monitor_pictures import indexes_of
from tests.services.monitor.test_monitor_teachers import told

LETTERS = len(tiles.palette())
SMALL = "####\n#@.#\n#$ #\n#  #\n####"


def written(text: str) -> Indexes:
    canvas = np.zeros((2 * font.HEIGHT, 2 * font.width_of(text)), np.uint8)
    font.write(canvas, text, (0, 0), LETTERS)
    return canvas


def doubtful(view: str, *said: tuple[str, str], visits: int = 1, state: bytes = b"a") -> Doubts:
    doubts = Doubts()
    for _ in range(visits):
        doubts.add(told(*said, view=view, state=state), 7)
    return doubts


def test_the_caption_is_whole_however_small_the_board_and_large_the_counts() -> None:
    said = (("ada", "UP"), ("ben", "LEFT"), ("cyd", "DOWN"), ("dan", "RIGHT"))
    worst = doubtful(SMALL, *said, visits=1_000).worst()
    picture = draw_doubtful(worst, Moment(1))
    assert picture is not None
    text = written("1: ←1000 →1000 ↑1000 ↓1000")
    top = read_view(SMALL).level.height * tiles.TILE + 4
    pixels = indexes_of(picture)
    assert np.array_equal(pixels[top : top + text.shape[0], : text.shape[1]], text)


def test_a_name_that_is_no_move_has_neither_an_arrow_nor_a_count() -> None:
    picture = draw_doubtful(doubtful(SMALL, ("ada", "UP"), ("ben", "PICKUP")).worst(), Moment(1))
    nothing = draw_doubtful(doubtful(SMALL, ("ada", "DROPOFF"), ("ben", "PICKUP")).worst(), Moment(1))
    assert picture is not None
    assert nothing is not None
    assert [arrow.vector for arrow in picture.arrows] == [(0.0, -12.0)]
    assert nothing.arrows == ()


def test_a_move_that_was_named_less_often_has_a_thinner_and_fainter_arrow() -> None:
    doubts = doubtful(SMALL, ("ada", "UP"), ("ben", "UP"), ("cyd", "LEFT"))
    picture = draw_doubtful(doubts.worst(), Moment(1))
    assert picture is not None
    left, up = picture.arrows
    assert left.width < up.width
    assert left.opacity < up.opacity == 1.0


def test_numbers_below_the_states_are_those_of_the_list() -> None:
    doubts = Doubts()
    for number in range(COLUMNS + 1):
        doubts.add(told(("ada", "UP"), ("ben", "LEFT"), view=SMALL, state=bytes([number])), 7)
    picture = draw_doubtful(doubts.worst(), Moment(1))
    assert picture is not None
    pixels, first, last = indexes_of(picture), written("1:"), written("4:")
    below = read_view(SMALL).level.height * tiles.TILE + 4
    half = pixels.shape[0] // 2
    assert np.array_equal(pixels[below : below + first.shape[0], : first.shape[1]], first)
    assert np.array_equal(pixels[half + below : half + below + last.shape[0], : last.shape[1]], last)
