import pytest

from services.teachers.key_gate import KeyGate, Press, Verdict

MS = 1_000_000


def pressed(gate: KeyGate[int], *presses: tuple[str, int]) -> list[Verdict]:
    return [gate.press(key, at_ms * MS) for key, at_ms in presses]


def test_a_press_counts_for_the_decision_on_screen_and_only_once() -> None:
    gate: KeyGate[int] = KeyGate()
    gate.show(1)
    assert pressed(gate, ("up", 5000), ("left", 5200)) == [Verdict.COUNTS, Verdict.ALREADY]


def test_a_press_before_the_decision_is_on_screen_is_dropped_and_not_kept() -> None:
    gate: KeyGate[int] = KeyGate()
    before = pressed(gate, ("up", 5000))
    gate.show(1)
    assert before == [Verdict.CLOSED]
    assert gate.confirmed(10_000 * MS) is None
    assert pressed(gate, ("up", 9000)) == [Verdict.COUNTS]


def test_another_key_counts_for_the_next_decision_at_once() -> None:
    gate: KeyGate[int] = KeyGate()
    gate.show(1)
    first = pressed(gate, ("up", 5000))
    gate.show(2)
    assert first + pressed(gate, ("left", 5060)) == [Verdict.COUNTS, Verdict.COUNTS]


@pytest.mark.parametrize("wait_ms,every_ms", [(250, 25), (500, 33), (660, 40), (1000, 100)])
def test_a_held_key_counts_once_however_many_decisions_pass(wait_ms: int, every_ms: int) -> None:
    gate: KeyGate[int] = KeyGate()
    gate.show(0)
    verdicts = pressed(gate, ("up", 5000))
    confirmed = []
    for number in range(1, 60):
        gate.show(number)
        at_ms = 5000 + wait_ms + (number - 1) * every_ms
        confirmed.append(gate.confirmed(at_ms * MS))
        verdicts += pressed(gate, ("up", at_ms))
        confirmed.append(gate.confirmed((at_ms + every_ms - 1) * MS))
    assert verdicts == [Verdict.COUNTS, Verdict.WAITS] + [Verdict.HELD] * 58
    assert set(confirmed) == {None}


def test_the_same_key_tapped_again_counts_after_it_is_known_not_to_be_held() -> None:
    gate: KeyGate[int] = KeyGate()
    gate.show(1)
    pressed(gate, ("up", 5000))
    gate.show(2)
    assert pressed(gate, ("up", 5400)) == [Verdict.WAITS]
    assert gate.confirmed(5549 * MS) is None
    gate.show(3)  # the window may close meanwhile: the press stays with its decision
    assert gate.confirmed(5550 * MS) == Press(2, "up", 5400 * MS)
    assert gate.confirmed(9999 * MS) is None


def test_while_a_press_waits_no_other_press_counts_for_its_decision() -> None:
    gate: KeyGate[int] = KeyGate()
    gate.show(1)
    pressed(gate, ("up", 5000))
    gate.show(2)
    assert pressed(gate, ("up", 5400), ("left", 5450)) == [Verdict.WAITS, Verdict.ALREADY]
    assert gate.confirmed(5600 * MS) == Press(2, "up", 5400 * MS)


def test_the_same_key_long_after_counts_at_once() -> None:
    gate: KeyGate[int] = KeyGate()
    gate.show(1)
    pressed(gate, ("up", 5000))
    gate.show(2)
    assert pressed(gate, ("up", 6101)) == [Verdict.COUNTS]


def test_a_key_held_since_before_the_decision_opened_does_not_answer_it() -> None:
    gate: KeyGate[int] = KeyGate()
    before = pressed(gate, ("up", 5000), ("up", 5500), ("up", 5530))
    gate.show(1)
    assert before + pressed(gate, ("up", 5560)) == [
        Verdict.CLOSED,
        Verdict.CLOSED,
        Verdict.HELD,
        Verdict.HELD,
    ]


def test_a_decision_answered_elsewhere_needs_no_key() -> None:
    gate: KeyGate[int] = KeyGate()
    gate.answered(1)
    gate.show(1)
    assert pressed(gate, ("up", 5000)) == [Verdict.ALREADY]
