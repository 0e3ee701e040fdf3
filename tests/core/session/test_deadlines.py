"""The packed deadlines behave as a short dictionary of the latest decisions."""

from hypothesis import given
from hypothesis import strategies as st

from sfid_core.session.deadlines import DEADLINES_KEPT, Deadlines

NOTES = st.lists(
    st.tuples(st.integers(0, 3), st.none() | st.integers(-(10**18), 2**62)), max_size=3 * DEADLINES_KEPT
)


@given(NOTES)
def test_the_latest_deadlines_are_told_and_older_ones_are_over(notes: list[tuple[int, int | None]]) -> None:
    """Decisions never go back; one comes again when its window is changed."""
    packed, plain, decision = Deadlines(), dict[int, int | None](), 0
    for onward, deadline_ns in notes:
        decision += onward
        packed.note(decision, deadline_ns)
        plain[decision] = deadline_ns
        if len(plain) > DEADLINES_KEPT:
            del plain[next(iter(plain))]
        assert len(packed) == len(plain)
    assert [packed.of(each) for each in range(decision + 2)] == [
        plain.get(each, 0) for each in range(decision + 2)
    ]
    packed.clear()
    assert (len(packed), packed.of(decision)) == (0, 0)
