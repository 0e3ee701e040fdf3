"""The picture of the world: palette, tiles, arrows, and which moment is shown."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from protocol.messages import SaidBy, Step
from services import tiles
from services.monitor.rows import Indexed, Moment, Picture
from services.monitor.scene import (
    AGENT_COLOUR,
    BUMPED_COLOUR,
    HOLD_S,
    Frame,
    Stage,
    TeacherColours,
    ViewError,
    draw_world,
    frames_of_step,
    read_view,
)
from sfid_core.sokoban.actions import Action
from tests.services.monitor.feeder import Lesson

VIEW = "#######\n#     #\n#@$ . #\n#     #\n#######"
SOLVED = "#######\n#     #\n#  @* #\n#     #\n#######"


def indexes_of(picture: Picture) -> npt.NDArray[np.uint8]:
    """The pixels of a picture that is drawn by palette."""
    assert isinstance(picture.image, Indexed)
    assert picture.image.indexes.max() < len(picture.image.palette) <= 256
    return picture.image.indexes


def cell_of(picture: npt.NDArray[np.uint8], row: int, column: int) -> npt.NDArray[np.uint8]:
    return picture[row * 16 : row * 16 + 16, column * 16 : column * 16 + 16]


def frame(view: str = VIEW, action: str | None = None, *said: SaidBy, bumped: bool = False) -> Frame:
    return Frame(Moment(3, 5), view, action, bumped, said)


def label(teacher: str, action: str) -> SaidBy:
    return SaidBy(teacher=teacher, kind="label", action=action)


def test_every_sprite_is_a_whole_tile_and_the_palette_fits_a_byte() -> None:
    for indexes, covers in (tiles.BOX, tiles.BOX_AT_HOME, tiles.GOAL, *tiles.KEEPER.values()):
        assert indexes.shape == covers.shape == (16, 16)
        assert indexes[covers].all()
    assert tiles.palette().shape == (2 * len(tiles.COLOURS) + tiles.VALUE_COLOURS, 3)
    assert len(tiles.palette()) <= 256


def test_the_picture_shows_player_box_and_goal_where_the_view_has_them() -> None:
    picture = indexes_of(draw_world(frame(action="RIGHT"), TeacherColours()))
    assert picture.shape == (5 * 16, 7 * 16)
    for sprite, row, column in ((tiles.KEEPER["RIGHT"], 2, 1), (tiles.BOX, 2, 2), (tiles.GOAL, 2, 4)):
        assert np.array_equal(cell_of(picture, row, column)[sprite[1]], sprite[0][sprite[1]])


def test_a_box_on_its_goal_looks_different_and_a_solved_view_can_be_drawn() -> None:
    picture = indexes_of(draw_world(frame(SOLVED), TeacherColours()))
    indexes, covers = tiles.BOX_AT_HOME
    assert np.array_equal(cell_of(picture, 2, 4)[covers], indexes[covers])


def test_the_agents_arrow_is_white_and_red_where_it_bumped() -> None:
    (moved,) = draw_world(frame(VIEW, "RIGHT"), TeacherColours()).arrows
    (bumped,) = draw_world(frame(VIEW, "LEFT", bumped=True), TeacherColours()).arrows
    assert (moved.colour, moved.vector, moved.label) == (AGENT_COLOUR, (12.0, 0.0), "")
    assert (bumped.colour, bumped.vector) == (BUMPED_COLOUR, (-12.0, 0.0))


def test_each_teachers_arrow_has_their_colour_and_direction_and_their_name_beyond_its_tip() -> None:
    colours = TeacherColours()
    arrows = draw_world(frame(VIEW, "UP", label("ada", "UP"), label("ben", "DOWN")), colours).arrows
    assert [(arrow.label, arrow.colour, arrow.vector) for arrow in arrows] == [
        ("", AGENT_COLOUR, (0.0, -12.0)),
        ("", colours.of("ada"), (0.0, -12.0)),
        ("ada", colours.of("ada"), (0.0, 0.0)),
        ("", colours.of("ben"), (0.0, 12.0)),
        ("ben", colours.of("ben"), (0.0, 0.0)),
    ]
    agent, up, ada, down, ben = arrows
    assert colours.of("ada") != colours.of("ben")
    assert agent.origin != up.origin
    assert ada.origin[1] < up.origin[1] + up.vector[1]
    assert ben.origin[1] >= down.origin[1] + down.vector[1]


@pytest.mark.parametrize("action", [action.name for action in Action])
def test_a_name_covers_neither_the_agent_nor_an_arrow(action: str) -> None:
    everybody = tuple(label(name, action) for name in ("ada", "ben", "cyd"))
    drawn = draw_world(frame(VIEW, action, *everybody), TeacherColours()).arrows
    names, arrows = [each for each in drawn if each.label], [each for each in drawn if not each.label]
    assert ([name.label for name in names], len(arrows)) == (["ada", "ben", "cyd"], 4)
    row = read_view(VIEW).player // read_view(VIEW).level.width
    covered = [(1.0 * row * tiles.TILE, 1.0 * (row + 1) * tiles.TILE)]
    for arrow in arrows:
        ends = (arrow.origin[1], arrow.origin[1] + arrow.vector[1])
        covered.append((min(ends) - arrow.width / 2, max(ends) + arrow.width / 2))
    for name in names:
        written = name.origin[1] + 0.35 * tiles.TILE
        upper, lower = written - 0.25 * tiles.TILE, written + 0.25 * tiles.TILE
        assert all(lower <= top or upper >= bottom for top, bottom in covered), name.label
        covered.append((upper, lower))


def test_a_crowd_is_one_arrow_with_its_number() -> None:
    crowd = [label(f"worker-{number}", "LEFT") for number in range(40)]
    arrows = draw_world(frame(VIEW, None, *crowd), TeacherColours()).arrows
    assert [arrow.label for arrow in arrows] == ["", "40 teachers"]


def test_a_reward_points_where_the_agent_went_and_shows_its_size() -> None:
    said = SaidBy(teacher="ada", kind="reward", reward=-1.0)
    assert [arrow.label for arrow in draw_world(frame(VIEW, "UP", said), TeacherColours()).arrows] == [
        "",
        "",
        "ada -1",
    ]


@pytest.mark.parametrize("view", ["", "nonsense", "####\n#  #\n####", VIEW + "\n\n" + VIEW])
def test_a_view_that_is_no_level_is_refused_in_one_line(view: str) -> None:
    with pytest.raises(ViewError) as refusal:
        read_view(view)
    assert str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_the_stage_shows_the_newest_frame_once() -> None:
    stage = Stage()
    stage.offer((frame(VIEW),))
    stage.offer((frame(SOLVED),))
    assert stage.due(1.0) == frame(SOLVED)
    assert stage.due(1.1) is None


def test_a_step_with_answers_is_held_before_the_next_decision_is_shown() -> None:
    stage = Stage()
    answered = replace(frame(VIEW, "UP", label("ada", "UP")), hold_s=HOLD_S)
    stage.offer((answered,))
    stage.offer((frame(SOLVED),))
    assert stage.due(1.0) == answered
    assert stage.due(1.0 + HOLD_S / 2) is None
    assert stage.due(1.0 + HOLD_S) == frame(SOLVED)


def test_newer_answers_overtake_older_ones() -> None:
    stage = Stage()
    first, second = (replace(frame(VIEW, "UP", label(name, "UP")), hold_s=HOLD_S) for name in ("ada", "ben"))
    stage.offer((first,))
    assert stage.due(1.0) == first
    stage.offer((second,))
    assert stage.due(1.1) == second


def test_the_last_step_of_an_episode_is_followed_by_the_board_it_ended_on() -> None:
    last = next(
        message
        for message in Lesson(room="#####\n#@$.#\n#####", episodes=1).messages()
        if isinstance(message, Step) and message.outcome == "solved"
    )
    decided, ended = frames_of_step(last, 7)
    assert (decided.view, decided.action, decided.bumped) == (last.view, last.action, False)
    moment = Moment(last.decision + 1, 7, last.episode)
    assert (ended.view, ended.action, ended.moment) == (last.next_view, None, moment)


def test_teachers_who_agree_have_an_arrow_and_a_name_each_in_their_colour() -> None:
    colours = TeacherColours()
    said = (label("ada", "UP"), label("ben", "UP"))
    arrows = draw_world(frame(VIEW, None, *said), colours).arrows
    expected = [(text, colours.of(name)) for name in ("ada", "ben") for text in ("", name)]
    assert [(arrow.label, arrow.colour) for arrow in arrows] == expected
