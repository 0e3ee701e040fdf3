"""Generated levels: as ordered, all different, the same from the same seed."""

from itertools import islice
from typing import Any

import pytest

from sfid_core.sokoban.board import Level
from sfid_core.sokoban.generator import Recipe, RecipeError, generate
from sfid_core.sokoban.levels import LevelError, collection, packaged, parse_levels
from sfid_core.sokoban.solver import solve
from sfid_core.sokoban.tables import count_states


def made(recipe: Recipe, seed: int, count: int) -> list[Level]:
    return list(islice(generate(recipe, seed), count))


def faults(level: Level, recipe: Recipe) -> list[str]:
    """Name everything in which a level is not as ordered."""
    found = []
    solution = solve(level)
    steps = solution.distance(level.start)
    if (level.width, level.height, len(level.boxes)) != (recipe.width, recipe.height, recipe.boxes):
        found.append("size")
    if steps is None or steps < recipe.steps_min:
        found.append(f"steps {steps}")
    if not level.goal_set.isdisjoint(level.boxes):
        found.append("a box stands on a goal")
    if count_states(level) > recipe.states_max:
        found.append("states")
    if not level.title.endswith(f", {steps} steps"):
        found.append(f"title {level.title!r}")
    floor = set(range(level.width * level.height)) - level.walls
    if floor != set(level.reach):
        found.append("floor out of reach")
    if parse_levels(level.to_xsb())[0].digest != level.digest:
        found.append("text")
    return found


@pytest.mark.parametrize(
    "recipe",
    [
        Recipe(),
        Recipe(width=7, height=3, boxes=1, steps_min=1),
        Recipe(width=6, height=9, boxes=1, steps_min=15),
        Recipe(width=7, height=7, boxes=3, steps_min=20, states_max=20_000),
        Recipe(width=24, height=24, boxes=1, steps_min=40),
    ],
)
@pytest.mark.parametrize("seed", [0, 2**53 - 1])
def test_every_generated_level_is_as_ordered_and_no_two_are_alike(recipe: Recipe, seed: int) -> None:
    levels = made(recipe, seed, 4)
    assert [faults(level, recipe) for level in levels] == [[]] * 4
    assert len({level.digest for level in levels}) == 4


def test_the_same_seed_gives_the_same_levels_and_another_seed_others() -> None:
    recipe = Recipe(boxes=3)
    first = made(recipe, 7, 5)
    assert made(recipe, 7, 5) == first
    assert made(recipe, 7, 2) == first[:2]
    assert not {level.digest for level in made(recipe, 8, 5)} & {level.digest for level in first}


@pytest.mark.parametrize(
    "name, index, recipe, number",
    [
        ("two-boxes", 0, Recipe(6, 6, 2, 12), 5),
        ("two-boxes", 1, Recipe(7, 7, 2, 20), 4),
        ("two-boxes", 2, Recipe(8, 8, 2, 28), 2),
        ("two-boxes", 3, Recipe(8, 8, 2, 38), 3),
        ("three-boxes", 0, Recipe(7, 7, 3, 20), 1),
        ("three-boxes", 1, Recipe(7, 7, 3, 30), 3),
        ("three-boxes", 2, Recipe(8, 8, 3, 40), 3),
    ],
)
def test_the_packaged_rooms_come_out_of_the_command_that_their_file_names(
    name: str, index: int, recipe: Recipe, number: int
) -> None:
    assert made(recipe, 2026, number + 1)[number].digest == packaged(name)[index].digest


def test_a_collection_reads_back_with_titles_and_authors() -> None:
    levels = (*made(Recipe(), 3, 2), *packaged("two-boxes"), parse_levels("#####\n#@$.#\n#####")[0])
    assert parse_levels(collection(levels)) == levels


@pytest.mark.parametrize(
    "fields, complaint",
    [
        ({"width": 25}, "width 25 is outside 3 to 24: choose another"),
        ({"height": 2}, "height 2 is outside 3 to 24: choose another"),
        ({"boxes": 0}, "boxes 0 is outside 1 to 8: choose another"),
        ({"steps_min": 0}, "steps_min 0 is outside 1 to 100000: choose another"),
        ({"states_max": 12_000_001}, "states_max 12000001 is outside 1 to 12000000: choose another"),
        (
            {"width": 4, "height": 4},
            (
                "a room of 4 x 4 with 2 boxes has 4 cells inside its walls; boxes, goals and player need 5: "
                "enlarge it or take fewer boxes"
            ),
        ),
        (
            {"width": 12, "height": 12, "boxes": 4},
            (
                "a room of 12 x 12 with 4 boxes has at least 3,655,600 states, more than 1,000,000; "
                "take fewer boxes or a smaller room"
            ),
        ),
    ],
)
def test_an_order_that_no_level_could_meet_is_refused(fields: dict[str, Any], complaint: str) -> None:
    with pytest.raises(RecipeError) as caught:
        Recipe(**fields)
    assert str(caught.value) == complaint


def test_an_order_that_no_room_meets_ends_with_one_line() -> None:
    with pytest.raises(LevelError) as caught:
        made(Recipe(5, 5, 1, 30), 0, 1)
    assert str(caught.value) == (
        "a room of 5 x 5 with one box that needs 30 steps or more: none in 2,000 rooms after the first 0; "
        "ask for fewer steps or a larger room"
    )


def test_a_room_that_has_two_levels_gives_each_once_and_then_says_so() -> None:
    """Three cells in a row: player, box, goal, from either side."""
    rooms = generate(Recipe(5, 3, 1, 1), 1)
    assert {next(rooms).to_xsb() for _ in range(2)} == {"#####\n#.$@#\n#####", "#####\n#@$.#\n#####"}
    with pytest.raises(RecipeError, match="after the first 2; ask for fewer steps"):
        next(rooms)
