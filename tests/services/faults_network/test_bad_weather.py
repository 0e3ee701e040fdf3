"""Slow, cut, one-way and spoilt links, stopped processes: nothing acknowledged is lost or counted twice."""

import threading
import time

import pytest

from protocol.messages import WindowSpec
from tests.services.cli.command_line import wait_for
from tests.services.faults_network.conftest import Tell
from tests.services.faults_network.rig import Rig, account, acknowledged, more
from tests.services.faults_network.weather import Proxy

pytestmark = [pytest.mark.real, pytest.mark.timeout(240)]

CUTS = 6
ANSWERS_SLOW = 12
FLIPS = 4
IN_FLIGHT = 4
"""Acknowledgements that may still be on their way when a fault begins."""
GOES_ON = IN_FLIGHT + 1
"""So many more prove that teaching goes on."""
SHORT_S, LONG_S = 0.6, 4.0
"""Under and over the lease of 2.5 s after which a silent process counts as gone."""
BACK_SHORT_S, BACK_LONG_S = 2.0, 10.0


def pause(seconds: float) -> None:
    """Let the fault last: nothing happens that could be waited for."""
    threading.Event().wait(seconds)


def test_late_labels_on_a_slow_link_are_kept_and_never_count_for_another_decision(
    rig: Rig, tell: Tell
) -> None:
    session = "slow"
    rig.create(session, WindowSpec(mode="early", span_ms=300), teachers_min=1)
    with Proxy(rig.router_port, 5) as link:
        link.weather.delay_ms, link.weather.jitter_ms = 50.0, 200.0
        with rig.teaching(session, 2, link.endpoint) as voices:
            wait_for("slow labels are acknowledged", more(voices, ANSWERS_SLOW), 120.0)
            link.weather.delay_ms = link.weather.jitter_ms = 0.0
    told = account(rig.data, session, voices)
    assert told.sound, told
    assert {voice.unacknowledged for voice in voices} == {0}
    late = sum(state.value == "too_late" for voice in voices for state, _ in voice.acknowledged.values())
    tell(
        "F9 slow link",
        "late labels are kept, never applied to another decision",
        told.acknowledged,
        "labels",
        f"0 misattributed, {late} kept as late",
    )


@pytest.mark.parametrize("who", ["teacher", "learner", "environment"])
def test_after_every_cut_of_a_link_teaching_goes_on(rig: Rig, tell: Tell, who: str) -> None:
    session = f"cut-{who}"
    rig.create(session)
    with Proxy(rig.router_port, 6) as own:
        link = {"learner": rig.learner_link, "environment": rig.environment_link}.get(who, own)
        worst_s, cut_before = 0.0, link.cuts
        with rig.teaching(session, 2, own.endpoint) as voices:
            wait_for("teaching has begun", more(voices, 5))
            for _ in range(CUTS):
                link.cut()
                began = time.monotonic()
                wait_for("teaching goes on", more(voices, GOES_ON), 30.0)
                worst_s = max(worst_s, time.monotonic() - began)
        assert link.cuts - cut_before >= CUTS
    told = account(rig.data, session, voices)
    assert told.sound, told
    assert {voice.unacknowledged for voice in voices} == {0}
    tell(
        f"F8 link of the {who} cut",
        "all labels acknowledged in the end, once",
        CUTS,
        "cuts",
        f"{told.acknowledged} labels, 0 lost, 0 twice; longest to 5 more labels {worst_s:.1f} s",
    )


@pytest.mark.parametrize(
    "way, lasts_s", [("both", SHORT_S), ("both", LONG_S), ("up", LONG_S), ("down", LONG_S)]
)
def test_a_partition_of_a_teacher_heals_and_queued_labels_are_drained(
    rig: Rig, tell: Tell, way: str, lasts_s: float
) -> None:
    session = f"apart-{way}-{int(lasts_s)}"
    rig.create(session)
    with Proxy(rig.router_port, 7) as link, rig.teaching(session, 1, link.endpoint) as voices:
        wait_for("teaching has begun", more(voices, 5))
        link.weather.open_up, link.weather.open_down = way == "down", way == "up"
        before = acknowledged(voices)
        pause(lasts_s)
        assert acknowledged(voices) - before <= IN_FLIGHT
        link.weather.open_up = link.weather.open_down = True
        began = time.monotonic()
        bound_s = BACK_SHORT_S if lasts_s < 2 else BACK_LONG_S
        wait_for("teaching goes on", more(voices, GOES_ON), bound_s)
        took_s = time.monotonic() - began
    told = account(rig.data, session, voices)
    assert told.sound, told
    tell(
        f"F8 teacher cut off for {lasts_s} s ({way})",
        f"back within {bound_s:.0f} s",
        told.acknowledged,
        "labels",
        f"0 lost, 0 twice, back after {took_s:.2f} s",
    )


@pytest.mark.parametrize("role", ["learner", "environment"])
def test_a_partition_of_a_service_heals_and_no_step_is_taken_twice(rig: Rig, tell: Tell, role: str) -> None:
    session = f"apart-{role}"
    rig.create(session)
    link = rig.learner_link if role == "learner" else rig.environment_link
    with rig.teaching(session, 2) as voices:
        wait_for("teaching has begun", more(voices, 5))
        link.weather.open_up = link.weather.open_down = False
        before = acknowledged(voices)
        pause(LONG_S)
        assert acknowledged(voices) - before <= IN_FLIGHT
        link.weather.open_up = link.weather.open_down = True
        began = time.monotonic()
        wait_for("teaching goes on", more(voices, GOES_ON), BACK_LONG_S)
        took_s = time.monotonic() - began
    told = account(rig.data, session, voices)
    assert told.sound, told
    assert {voice.unacknowledged for voice in voices} == {0}
    tell(
        f"F8 {role} cut off for {LONG_S:.0f} s",
        "nothing lost, no step twice",
        told.acknowledged,
        "labels",
        f"0 lost, 0 twice, back after {took_s:.2f} s",
    )


@pytest.mark.parametrize("role", ["router", "environment", "learner"])
def test_a_process_that_was_held_still_goes_on_where_it_was(rig: Rig, tell: Tell, role: str) -> None:
    session = f"held-{role}"
    rig.create(session)
    took: list[float] = []
    with rig.teaching(session, 2) as voices:
        for lasts_s, bound_s in ((SHORT_S, BACK_SHORT_S), (LONG_S, BACK_LONG_S)):
            wait_for("teaching goes on before", more(voices, 5))
            with rig.stopped(role):
                before = acknowledged(voices)
                pause(lasts_s)
                assert acknowledged(voices) - before <= IN_FLIGHT
            began = time.monotonic()
            wait_for("it goes on", more(voices, GOES_ON), bound_s)
            took.append(time.monotonic() - began)
    told = account(rig.data, session, voices)
    assert told.sound, told
    assert {voice.unacknowledged for voice in voices} == {0}
    tell(
        f"F7 {role} stopped for {SHORT_S} and {LONG_S:.0f} s",
        "labels go on within 2 and 10 s",
        told.acknowledged,
        "labels",
        f"0 lost, 0 twice, after {took[0]:.2f} and {took[1]:.2f} s",
    )


def test_bits_turned_over_on_the_way_make_no_wrong_label(rig: Rig, tell: Tell) -> None:
    session = "spoilt"
    rig.create(session)
    with Proxy(rig.router_port, 8) as link, rig.teaching(session, 2, link.endpoint) as voices:
        wait_for("teaching has begun", more(voices, 5))
        link.weather.flip_share = 0.02
        wait_for("bits were turned over", lambda: link.flips >= FLIPS, 200.0)
        link.weather.flip_share = 0.0
        # A spoilt declaration leaves a session deaf though its link is well: only a new link mends it.
        link.cut()
        wait_for("teaching goes on", more(voices, 5), 60.0)
    told = account(rig.data, session, voices)
    assert told.sound, told
    tell(
        "F13 bits turned over on a link",
        "no wrong label",
        link.flips,
        "bits",
        f"0 wrong of {told.acknowledged} labels, {link.connections} connections made",
    )
