"""What teachers and watchers see of worlds that are no Sokoban: text, pictures, keys for their actions."""

from base64 import b64decode, b64encode
from pathlib import Path

import msgspec
import numpy as np
import pytest

from protocol.messages import CreateSession, Decision
from services.experiments.other_method import Misfit, replay_with
from services.gym.rendering import as_picture, is_board
from services.monitor.chronicle import Chronicle
from services.monitor.rows import Moment, Picture
from services.monitor.scene import Frame, TeacherColours, ViewError, draw_world, frame_of_decision
from services.monitor.session_view import SessionView
from services.teachers import panel
from services.teachers.grid import shown
from services.teachers.spoken import spoken
from sfid_core.sokoban.levels import packaged
from tests.protocol.samples import DECISION, STEP
from tests.services.gym.lakes import DRY_LAKE
from tests.services.learner.classroom import UNTIL_ANSWERED, Classroom, Pupil
from tests.services.monitor.test_monitor_pictures import indexes_of

LAKE = "[S] F \n F  H "
TAXI = ("DOWN", "UP", "RIGHT", "LEFT", "PICKUP", "DROPOFF")
ROOM = packaged("room")[0].to_xsb()
RIDE = msgspec.structs.replace(DECISION, view=" |[ ] : {R} |", actions=TAXI)


def pictures(chronicle: Chronicle) -> list[Picture]:
    return chronicle.take().scene


def test_a_board_is_told_from_what_other_worlds_show() -> None:
    assert is_board(ROOM)
    assert is_board("#####\n#@$.#\n#####")
    assert not any(
        is_board(view) for view in ("", LAKE, "(7, 10, 0)", "data:image/png;base64,iVBO", "o  x\nC  T")
    )


def test_the_monitor_draws_text_and_hands_pictures_on_as_they_came() -> None:
    drawn = draw_world(Frame(Moment(0), LAKE), TeacherColours())
    other = draw_world(Frame(Moment(0), LAKE.replace("S", "X")), TeacherColours())
    assert not np.array_equal(indexes_of(drawn), indexes_of(other))
    assert drawn.arrows == ()
    large = draw_world(Frame(Moment(0), "\n".join(["x" * 200] * 200)), TeacherColours())
    assert indexes_of(large).nbytes < 1_000_000, "viewers are sent raw pixels"
    view = as_picture(np.full((40, 40, 3), 90, np.uint8))
    assert draw_world(Frame(Moment(0), view), TeacherColours()).image == b64decode(view.partition(",")[2])
    jpeg, empty = b64encode(b"\xff\xd8\xff\xe0 a photograph").decode(), ""
    for held in ("!!", jpeg, empty, view.partition(",")[2][4:]):
        with pytest.raises(ViewError, match="begins like a picture and holds none"):
            draw_world(Frame(Moment(0), f"data:image/png;base64,{held}"), TeacherColours())


def test_the_chronicle_keeps_such_a_world_without_policy_and_conflicts_and_without_a_warning() -> None:
    chronicle = Chronicle()
    chronicle.tell(RIDE)
    step = msgspec.structs.replace(
        STEP, view=RIDE.view, next_view=LAKE, action="PICKUP", said=(), label=None, values=(0.0,) * 6
    )
    chronicle.tell(step)
    assert {row.entity for row in pictures(chronicle)} == {"world"}
    assert chronicle.unreadable_views == 0


def test_a_session_view_of_such_a_world_draws_its_scene_and_no_policy() -> None:
    view = SessionView(0.0)
    view.past_is_told()
    view.take(RIDE, 0.0)
    view.take(msgspec.structs.replace(STEP, view=RIDE.view, next_view=LAKE, values=(0.0,) * 6), 0.1)
    entities = {row.entity for now in (0.2, 1.0, 2.0) for row in view.tick(now).live.scene}
    assert entities == {"world"}
    assert frame_of_decision(RIDE, None).view == RIDE.view


def test_the_terminal_shows_text_as_it_stands_and_tells_of_a_picture() -> None:
    assert shown(LAKE, 20, 10).plain == LAKE
    assert shown(LAKE, 2, 1).plain == "[S] "
    assert "browser" in shown("data:image/png;base64,iVBO", 20, 10).plain
    assert "@@" in shown(ROOM, 20, 10).plain


def test_keys_name_actions_by_direction_and_by_number() -> None:
    assert spoken(RIDE, "left") == ("← LEFT", "label", "LEFT", None, (), None)
    pickup = spoken(RIDE, "5")
    assert pickup is not None
    assert (pickup.text, pickup.kind, pickup.action) == ("PICKUP", "label", "PICKUP")
    assert spoken(RIDE, "7") is None
    walk = msgspec.structs.replace(RIDE, actions=("STAY", "JUMP"))
    assert spoken(walk, "left") is None
    guided = spoken(msgspec.structs.replace(walk, asked="guidance"), "2")
    assert guided is not None
    assert guided.guidance == ("JUMP",)


def test_the_panel_asks_for_actions_where_there_are_others_than_the_four_ways() -> None:
    def told(decision: Decision) -> tuple[str, str]:
        return panel.question(decision).plain, panel.key_line(decision).splitlines()[0].split("     ")[0]

    assert told(DECISION) == ("Which way would you go?", "arrows, hjkl or wasd  the way you would go")
    assert told(RIDE) == ("What would you do?", "1 DOWN   2 UP   3 RIGHT   4 LEFT   5 PICKUP   6 DROPOFF")


def test_a_session_in_another_world_is_no_fit_for_another_method_and_no_reason_to_fail(
    tmp_path: Path,
) -> None:
    room = Classroom(tmp_path / "data")
    room.create(CreateSession(session="s1", world=DRY_LAKE, window=UNTIL_ANSWERED, episodes=1))
    ann = Pupil(room, "ann")
    ann.join()
    assert ann.label(room.decision, "DOWN").code == "accepted"
    room.pass_time(600)
    room.shard.close()
    assert replay_with(tmp_path / "data", "sfid", {}) == [
        Misfit("s1", "taught in FrozenLake-v1 (is_slippery=False): other methods are judged on levels alone")
    ]
