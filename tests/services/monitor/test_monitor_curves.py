"""Curves, lanes, events and the mirror of values, without a viewer."""

import msgspec
import numpy as np

from protocol.messages import Decision, Episode, SaidBy, Step
from services import tiles
from services.monitor import curves
from services.monitor.chronicle import Chronicle
from services.monitor.policy import ValueMirror, draw_policy
from services.monitor.rows import Document, Lane, Moment
from services.monitor.sampling import MS, Pace
from services.monitor.scene import read_view
from services.monitor.status import (
    EPISODES,
    EPISODES_SHOWN,
    episodes_markdown,
    event_of_episode,
    open_markdown,
    step_markdown,
)
from tests.services.monitor.feeder import ROOM, SOLUTION_ROOM, WALL_NS, Lesson
from tests.services.monitor.test_monitor_pictures import cell_of, indexes_of


def episodes(count: int) -> list[Episode]:
    lesson = Lesson(room=SOLUTION_ROOM, episodes=count)
    return [message for message in lesson.messages() if isinstance(message, Episode)]


def a_step(action: str, *labels: tuple[str, str]) -> Step:
    steps = Lesson(episodes=1).messages()
    step = next(message for message in steps if isinstance(message, Step))
    said = tuple(SaidBy(teacher=teacher, kind="label", action=label) for teacher, label in labels)
    return Step(
        **{**{name: getattr(step, name) for name in step.__struct_fields__}, "action": action, "said": said}
    )


def at(second: int, step: Step) -> Step:
    return msgspec.structs.replace(step, at_ns=WALL_NS + second * 1000 * MS)


def test_of_rows_closer_together_than_the_gap_the_first_is_kept() -> None:
    pace = Pace(100)
    times_ms = (0, 40, 99, 100, 150, 210, 50, 149)  # the clock was set back before the last two
    assert [at for at in times_ms if pace.due(at * MS)] == [0, 100, 210, 50]


def test_episodes_come_out_in_order_and_each_once() -> None:
    told = episodes(4)
    sequence = curves.EpisodeSequence()
    sequence.offer(told[1])
    assert (sequence.take(), sequence.missing()) == ([], 0)
    sequence.offer(told[0])
    sequence.offer(told[0])
    sequence.offer(told[3])
    assert (sequence.take(), sequence.missing()) == (told[:2], 2)
    sequence.offer(told[1])
    sequence.skip()
    assert (sequence.take(), sequence.missing(), sequence.expected()) == (told[3:], None, 4)


def test_every_episode_is_a_row_of_each_curve() -> None:
    told = episodes(12)
    collected = curves.EpisodeCurves()
    for number, episode in enumerate(told):
        collected.add(episode, number)
    batches = {batch.entity: batch for batch in collected.take()}
    assert collected.take() == []
    moments = tuple(Moment(episode.decision, number, episode.episode) for number, episode in enumerate(told))
    assert all(batch.moments == moments for batch in batches.values())
    steps = [episode.steps for episode in told]
    means = [float(np.mean(steps[max(0, number - 9) : number + 1])) for number in range(12)]
    expected: dict[str, list[tuple[float, ...]]] = {
        curves.STEPS: [(step, mean, 1.0) for step, mean in zip(steps, means, strict=True)],
        curves.TD_ERROR: [(episode.abs_td_error, episode.abs_td_error_shaped) for episode in told],
        curves.RETURN: [(episode.discounted_return, episode.discounted_env_return) for episode in told],
        curves.INPUTS: [(episode.inputs,) for episode in told],
    }
    assert {entity: batch.values.tolist() for entity, batch in batches.items()} == {
        entity: [[float(value) for value in row] for row in rows] for entity, rows in expected.items()
    }
    assert all(batches[entity].values.shape[1] == len(curves.SERIES[entity]) for entity in batches)


def test_agreement_is_the_share_of_single_labels_that_named_the_agents_action() -> None:
    agreement = curves.Agreement()
    agreement.add(at(0, a_step("UP", ("ada", "UP"), ("ben", "DOWN"))), Moment(0, 0))
    agreement.add(at(1, a_step("UP")), Moment(1, 0))
    agreement.add(at(2, a_step("LEFT", ("ada", "LEFT"), ("ben", "LEFT"))), Moment(2, 0))
    (batch,) = agreement.take()
    assert ([moment.step for moment in batch.moments], batch.values.tolist()) == ([0, 2], [[0.5], [0.75]])
    assert agreement.take() == []


def test_a_lane_holds_each_label_until_the_step_after_it_and_tells_whether_the_agent_did_it() -> None:
    lanes = curves.Lanes()
    said = {4: "UP", 5: "LEFT", 9: "DOWN"}
    for step in range(4, 12):
        labels = [("ada", said[step])] if step in said else []
        lanes.add(at(step, a_step("UP", *labels)), Moment(step, 0))
    steps = (4, 5, 6, 9, 10)
    states = ("UP", "LEFT≠", "", "DOWN≠", "")
    assert lanes.take() == [Lane("ada", tuple(Moment(step, 0) for step in steps), states)]
    assert lanes.take() == []


def test_teachers_beyond_the_lanes_are_left_out() -> None:
    lanes = curves.Lanes()
    lanes.add(a_step("UP", *((f"t{number}", "UP") for number in range(30))), Moment(0, 0))
    assert [lane.teacher for lane in lanes.take()] == [f"t{number}" for number in range(curves.LANES_MAX)]


def test_a_flood_of_events_is_cut_and_counted() -> None:
    log = curves.EventLog()
    for number in range(curves.EVENTS_MAX + 88):
        log.add(Moment(number, 0), f"event {number}")
    (events,) = log.take()
    assert len(events.texts) == curves.EVENTS_MAX
    assert events.texts[0] == "event 0"
    assert events.texts[-1] == "… and 89 more events"


def test_the_mirror_finds_the_learners_rows_under_the_boards_own_keys() -> None:
    lesson = Lesson(room=ROOM, episodes=1)
    mirror = ValueMirror()
    steps = [message for message in lesson.messages() if isinstance(message, Step)]
    for step in steps:
        mirror.learn(step.state, step.values)
    board = read_view(steps[0].view)
    same_boxes = [step for step in steps if read_view(step.view).boxes == board.boxes]
    expected = {read_view(step.view).player: step.values for step in same_boxes}
    assert mirror.around(board) == expected
    assert len(expected) > 1


def test_the_mirror_forgets_the_row_learnt_longest_ago() -> None:
    mirror = ValueMirror(rows_max=2)
    for state in (b"a", b"b", b"a", b"c"):
        mirror.learn(state, (0.0,) * 4)
    board = read_view(SOLUTION_ROOM.strip())
    mirror.learn(board.state_key(), (0.0, 1.0, 0.0, 0.0))
    assert len(mirror) == 2
    assert mirror.around(board) == {board.player: (0.0, 1.0, 0.0, 0.0)}


def test_the_policy_shows_the_best_action_and_the_value_where_it_is_known() -> None:
    board = read_view("######\n#@ $.#\n######")
    mirror = ValueMirror()
    mirror.learn(board.state_key(), (0.0, 2.0, 0.0, 0.0))
    mirror.learn(board.with_state(board.player + 1, board.boxes).state_key(), (5.0, 5.0, 0.0, 0.0))
    picture = draw_policy(board, mirror, Moment(8, 9))
    (arrow,) = picture.arrows
    assert arrow.vector[0] > 0
    assert arrow.vector[1] == 0
    indexes = indexes_of(picture)
    assert cell_of(indexes, 1, 1)[8, 8] == tiles.VALUES
    assert cell_of(indexes, 1, 2)[8, 8] == tiles.VALUES + tiles.VALUE_COLOURS - 1


def test_the_policy_dims_all_but_boxes_and_what_is_known() -> None:
    board = read_view("######\n#@ $.#\n######")
    mirror = ValueMirror()
    mirror.learn(board.state_key(), (0.0, 2.0, 0.0, 0.0))
    elsewhere = board.with_state(board.player, (board.player + 1,))
    mirror.learn(elsewhere.with_state(board.player + 3, elsewhere.boxes).state_key(), (9.0, 0.0, 0.0, 0.0))
    indexes = indexes_of(draw_policy(board, mirror, Moment(1)))
    bright = tiles.background(board.level)
    known, box, inner = (1, 1), (1, 3), slice(1, -1)
    for row in range(board.level.height):
        for column in range(board.level.width):
            cell, as_it_is = cell_of(indexes, row, column), cell_of(bright, row, column)
            if (row, column) == known:
                assert (cell[inner, inner] == tiles.VALUES).all()
            elif (row, column) == box:
                sprite, covers = tiles.BOX
                assert np.array_equal(cell[covers], sprite[covers])
            else:
                assert np.array_equal(cell, as_it_is + tiles.DIMMED), (row, column)


def test_the_table_of_episodes_ends_with_the_newest_as_the_events_do() -> None:
    chronicle, lesson = Chronicle(), list(Lesson(room=SOLUTION_ROOM, episodes=50).messages())
    for message in lesson:
        chronicle.tell(message)
    tables = [row for row in chronicle.take().curves if isinstance(row, Document) and row.entity == EPISODES]
    ended = [message for message in lesson if isinstance(message, Episode)]
    assert 1 < len(tables) < len(ended)
    assert tables[-1].markdown.splitlines()[:2] == ["### lesson · method sfid · 50 episodes", ""]
    lines = tables[-1].markdown.splitlines()[4:]
    assert [int(line.split("|")[1]) for line in lines] == list(range(51 - EPISODES_SHOWN, 51))
    last = ended[-1]
    expected = [
        "50", str(last.steps), str(last.optimal_steps), f"{last.discounted_return:+.2f}",
        f"{last.abs_td_error:.3f}", str(last.inputs), "solved",
    ]  # fmt: skip
    assert [cell.strip() for cell in lines[-1].strip("|").split("|")] == expected
    unknown = episodes_markdown([msgspec.structs.replace(last, optimal_steps=None, outcome="cap")])
    assert unknown.splitlines()[2].split("|")[3].strip() == ""
    assert "gave up" in unknown


def test_how_things_stand_begins_with_the_name_of_the_session_and_where_it_is() -> None:
    messages = list(Lesson(session="monday", episodes=3).messages())
    opened = next(message for message in messages if isinstance(message, Decision))
    learnt = next(message for message in messages if isinstance(message, Step))
    assert open_markdown(opened, None, 1.0, 0.0).startswith("**monday** · episode 1 of 3, step 1\n")
    between = msgspec.structs.replace(opened, phase="beginning", episode=1)
    assert open_markdown(between, None, None, 0.0).startswith("**monday** · episode 2 of 3\n")
    over = msgspec.structs.replace(opened, phase="finished", episode=3)
    assert open_markdown(over, None, None, 0.0).startswith("**monday** · 3 of 3 episodes\n")
    assert step_markdown(learnt, opened).startswith("**monday** · episode 1 of 3, step 1\n")
    assert step_markdown(learnt, None).startswith("**monday** · episode 1, step 1\n")


def test_the_line_of_an_unsolved_episode_does_not_call_a_longer_way_the_fewest() -> None:
    ended = next(
        each for each in Lesson(room=SOLUTION_ROOM, episodes=1).messages() if isinstance(each, Episode)
    )
    lost = msgspec.structs.replace(ended, steps=3, optimal_steps=5, outcome="deadlock")
    solved = msgspec.structs.replace(lost, steps=7, outcome="solved")
    assert event_of_episode(lost).startswith("episode 1 ended in a deadlock: 3 steps (to solve it takes 5), ")
    assert event_of_episode(solved).startswith("episode 1 solved: 7 steps (fewest 5), ")
