"""What is best, by value iteration, against what is known of the classic environments."""

import gymnasium
import numpy as np
import pytest

from services.gym.digest import state_key
from services.gym.errors import GymError
from services.gym.oracle import Transitions, optimal_actions, table_of
from services.gym.rendering import as_observed, as_picture, as_text
from services.gym.world import GymGround
from tests.services.gym.lakes import CLIFF, DRY_LAKE, ICE, TAXI


def test_a_corridor_is_worth_what_a_hand_computes() -> None:
    table = Transitions.of({
        0: {0: [(1.0, 0, 0.0, False)], 1: [(0.5, 1, 0.0, False), (0.5, 0, -1.0, False)]},
        1: {0: [(1.0, 0, 0.0, False)], 1: [(1.0, 1, 2.0, True)]},
    })  # fmt: skip
    # v1 = 2; v0 = max(0.5 v0, 0.5 * 0.5 * 2 + 0.5 (-1 + 0.5 v0)) = max(0.5 v0, 0.25 v0) = 0
    worths = table.solve(gamma=0.5)
    assert worths == pytest.approx(np.array([[0.0, 0.0], [0.0, 2.0]]))
    assert optimal_actions(worths) == ((0, 1), (1,))
    assert (table.best_ending, table.step_reward, table.is_certain) == (2.0, 0.0, False)


def test_the_best_way_over_slippery_ice_arrives_fourteen_times_in_seventeen() -> None:
    table = table_of(gymnasium.make("FrozenLake-v1", is_slippery=True))
    assert table is not None
    policy = np.array([row[0] for row in optimal_actions(table.solve())])
    assert table.evaluate(policy, 1.0)[0] == pytest.approx(14 / 17, abs=1e-6)


def test_every_taxi_ride_of_the_oracle_takes_the_fewest_steps() -> None:
    ground = GymGround(TAXI, 3)
    for episode in range(20):
        course = ground.begin(episode)
        fewest, taken = course.optimal_steps, 0
        outcome = "running"
        while outcome == "running":
            _, left = course.act(TAXI.actions[ground.optimal[course.state][0]], taken)
            outcome, taken = left.value, taken + 1
        assert (outcome, taken) == ("solved", fewest)


def test_fewest_steps_are_known_where_chance_has_no_part() -> None:
    assert GymGround(DRY_LAKE, 0).begin(0).optimal_steps == 6
    assert GymGround(CLIFF, 0).begin(0).optimal_steps == 13
    assert GymGround(ICE, 0).begin(0).optimal_steps is None


def test_a_table_of_other_numbers_is_no_oracle() -> None:
    class Odd:
        observation_space = gymnasium.spaces.Discrete(2)
        P = {1: {0: [(1.0, 1, 0.0, True)]}, 2: {0: [(1.0, 1, 0.0, True)]}}  # noqa: RUF012 - as Gymnasium has it

        @property
        def unwrapped(self) -> "Odd":
            return self

    assert table_of(Odd()) is None


def test_observations_have_one_key_each_whatever_kind_of_number_they_are() -> None:
    different = [
        0, 1, "1", b"1", None, True, (1,), (1, 1), ((1,), 1), {"a": 1}, {"a": (1,)}, "a", ("a", 1),
        np.zeros(2, np.int8), np.zeros((1, 2), np.int8), np.zeros((2, 1), np.int8), np.ones(2, np.int8),
    ]  # fmt: skip
    assert len({state_key(each) for each in different}) == len(different)
    assert state_key(np.int64(7)) == state_key(7)
    assert state_key({"b": 1, "a": 2}) == state_key({"a": 2, "b": 1})
    assert state_key(np.zeros(2, np.uint8)) == state_key(np.zeros(2, np.int64))
    assert state_key([1, 2]) == state_key((1, 2))
    assert len(state_key(7)) == 16
    for endless in (1.5, np.zeros(2), object()):
        with pytest.raises(GymError, match="a table needs states it can meet again"):
            state_key(endless)


def test_colours_become_marks_in_columns_that_stay_in_line() -> None:
    drawn = "  (South)\n|\x1b[35mR\x1b[0m: |\n|\x1b[43m \x1b[0m:\x1b[34;1mB\x1b[0m|\n\n"
    assert as_text(drawn) == " | {R} :     |\n | [ ] : <B> |"
    assert as_text("|\x1b[35m\x1b[42mY\x1b[0m\x1b[0m|") == " | (Y} |"
    assert as_text("\no  x\no  T\n\n") == "o  x\no  T"
    assert "\x07" not in as_text("a\x07b")
    assert as_observed((7, 10, 0)) == "(7, 10, 0)"


def test_a_picture_that_is_too_large_is_halved_until_it_fits() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (400, 600, 3)).astype(np.uint8)
    text = as_picture(noise)
    assert text.startswith("data:image/png;base64,")
    assert len(text) <= 32_768
