"""Virtual time: appointments in order, chance by name."""

from services.runtime.timeline import Timeline, dice


def test_appointments_are_kept_in_the_order_of_time_and_then_of_setting() -> None:
    timeline = Timeline(wall_ns=1_000)
    kept: list[tuple[str, int]] = []
    timeline.call_at(20, lambda: kept.append(("third", timeline.now_ns())))
    timeline.call_in(10, lambda: kept.append(("first", timeline.now_ns())))
    timeline.call_at(10, lambda: kept.append(("second", timeline.now_ns())))
    while timeline.step():
        pass
    assert kept == [("first", 10), ("second", 10), ("third", 20)]
    assert (timeline.happened, timeline.wall_ns()) == (3, 1_020)


def test_an_appointment_in_the_past_is_the_next_one_and_time_does_not_go_back() -> None:
    timeline = Timeline()
    timeline.call_at(50, lambda: timeline.call_at(10, lambda: None))
    assert timeline.step()
    assert timeline.step()
    assert timeline.now_ns() == 50
    assert not timeline.step()


def test_setting_the_clock_moves_what_people_see_and_no_span() -> None:
    timeline = Timeline(wall_ns=100)
    timeline.jump(-60)
    assert (timeline.now_ns(), timeline.wall_ns()) == (0, 40)


def test_streams_of_chance_belong_to_their_names() -> None:
    assert dice(1, "a").random() == dice(1, "a").random()
    assert len({dice(1, "a").random(), dice(1, "b").random(), dice(2, "a").random()}) == 3
