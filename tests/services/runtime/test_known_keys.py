"""Keys are made known once, and only those in use."""

from services.runtime.known_keys import KNOWN_KEYS_MAX, USES_TO_KNOW, KnownKeys


def test_a_key_goes_by_name_until_it_has_been_used_some_times_and_is_declared_once() -> None:
    declared: list[str] = []

    def declare(key: str) -> int:
        declared.append(key)
        return len(declared)

    known = KnownKeys(declare)
    used = [known.use("a") for _ in range(USES_TO_KNOW + 3)]
    assert used == ["a"] * USES_TO_KNOW + [1, 1, 1]
    assert known.use("b") == "b"
    assert declared == ["a"]


def test_keys_beyond_the_most_that_are_counted_go_by_name_for_ever() -> None:
    known = KnownKeys(str.upper)
    for number in range(KNOWN_KEYS_MAX):
        known.use(f"k{number}")
    assert [known.use("late") for _ in range(2 * USES_TO_KNOW)] == ["late"] * 2 * USES_TO_KNOW
    assert [known.use("k0") for _ in range(USES_TO_KNOW)][-1] == "K0"
