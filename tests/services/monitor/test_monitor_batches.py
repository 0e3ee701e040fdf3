"""Rows for the file come in few batches: Rerun keeps something about each until the file is closed."""

from collections import Counter

import numpy as np

from services.monitor.rows import (
    Curves,
    Document,
    Events,
    Lane,
    Moment,
    Picture,
    Reliabilities,
    Row,
    Rows,
    merged,
)
from services.monitor.session_view import FILE_PERIOD_S, SessionView
from tests.services.monitor.feeder import Lesson

TICK_S = 0.05
DECISIONS_A_SECOND = 5
MINUTES = 2


def single(step: int) -> list[Row]:
    """One row of each kind, and two of the kinds that there are several of."""
    at = (Moment(step),)
    return [
        Curves("curves/steps", at, np.array([[step, -step]], float)),
        Curves("curves/inputs", at, np.array([[step]], float)),
        Lane("ann", at, (f"LEFT{step}",)),
        Lane("ben", at, (f"UP{step}",)),
        Reliabilities("ann", "ann", (1, 2, 3), at, (step / 10,), (step / 100,)),
        Events(at, (f"line {step}",), ("INFO" if step % 2 else "WARN",)),
        Document("now", at[0], f"text {step}"),
        Picture("world", at[0], b"%d" % step),
    ]


def test_batches_of_one_curve_lane_or_log_become_one_and_nothing_else_changes() -> None:
    rows = [row for step in range(5) for row in single(step)]
    steps = tuple(Moment(step) for step in range(5))
    curves, inputs, ann, ben, known, events, *others = merged(rows)
    assert isinstance(curves, Curves)
    assert (curves.entity, curves.moments) == ("curves/steps", steps)
    assert curves.values.tolist() == [[step, -step] for step in range(5)]
    assert isinstance(inputs, Curves)
    assert (inputs.entity, inputs.values.tolist()) == ("curves/inputs", [[step] for step in range(5)])
    assert ann == Lane("ann", steps, tuple(f"LEFT{step}" for step in range(5)))
    assert ben == Lane("ben", steps, tuple(f"UP{step}" for step in range(5)))
    shares = tuple(step / 10 for step in range(5)), tuple(step / 100 for step in range(5))
    assert known == Reliabilities("ann", "ann", (1, 2, 3), steps, *shares)
    levels = ("WARN", "INFO", "WARN", "INFO", "WARN")
    assert events == Events(steps, tuple(f"line {step}" for step in range(5)), levels)
    assert others == [row for row in rows if isinstance(row, Document | Picture)]


def test_a_curve_keeps_each_name_that_the_legend_has_for_it() -> None:
    def told(step: int, label: str) -> Reliabilities:
        return Reliabilities("ann", label, (1, 2, 3), (Moment(step),), (0.5,), (0.1,))

    alone, third = merged([told(0, "ann (of two)"), told(1, "ann (of two)"), told(2, "ann")])
    both = (Moment(0), Moment(1)), (0.5, 0.5), (0.1, 0.1)
    assert alone == Reliabilities("ann", "ann (of two)", (1, 2, 3), *both)
    assert third == told(2, "ann")


def kept_of(view: SessionView) -> list[Rows]:
    """Return what is written to the file of some minutes at five decisions a second, but for the end."""
    messages, kept = iter(Lesson(episodes=1_000).messages()), []
    ticks_a_decision = round(1 / DECISIONS_A_SECOND / TICK_S)
    for tick in range(round(MINUTES * 60 / TICK_S)):
        now_s = tick * TICK_S
        if tick % ticks_a_decision == 0:
            for _ in range(3):  # opened, closed, learnt; an end of an episode now and then
                view.take(next(messages), now_s)
        rows = view.tick(now_s).kept
        if rows.scene or rows.curves:
            kept.append(rows)
    return kept


def test_the_file_is_given_one_batch_of_each_kind_in_ten_seconds() -> None:
    kept = kept_of(SessionView(0.0))
    assert 1 < len(kept) <= MINUTES * 60 / FILE_PERIOD_S + 1
    for rows in kept:
        kinds = Counter(
            (type(row), getattr(row, "entity", getattr(row, "teacher", "")))
            for row in rows.curves
            if not isinstance(row, Document | Picture)
        )
        assert set(kinds.values()) <= {1}


def test_of_several_texts_in_a_batch_viewers_are_sent_the_newest_and_the_recording_has_all() -> None:
    view, kept, live = SessionView(0.0), 0, 0
    for number, message in enumerate(Lesson(room="#####\n#@$.#\n#####", episodes=400).messages()):
        view.take(message, number / 10)
    for due in (view.tick(1000.0), view.flush(1001.0)):
        kept += sum(isinstance(row, Document) and row.entity == "episodes" for row in due.kept.curves)
        live += sum(isinstance(row, Document) and row.entity == "episodes" for row in due.live.curves)
    assert kept > 5
    assert live == 1
