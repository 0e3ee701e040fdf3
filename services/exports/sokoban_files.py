"""What other Sokoban programs read: the levels of a session in XSB, its episodes as LURD solutions."""

from protocol.messages import World
from services.exports.session_story import Story, kept_steps
from services.exports.table import ExportError
from sfid_core.sokoban.actions import Action
from sfid_core.sokoban.levels import parse_levels
from sfid_core.sokoban.lurd import to_lurd


def xsb_levels(story: Story) -> str:
    """Return the level and every other state in which an episode began, each once, with their titles.

    Raises: ExportError for a world that is not Sokoban.
    """
    world = _sokoban(story)
    found: dict[str, list[int]] = {world.level: []}
    for row in story.steps:
        if row.measures.step == 0:
            found.setdefault(row.measures.view, []).append(row.measures.episode)
    return (
        "\n\n".join(
            f"{view}\nTitle: {world.level_name} {number}\n{_episodes(episodes)}"
            for number, (view, episodes) in enumerate(found.items())
        )
        + "\n"
    )


def lurd_solutions(story: Story) -> str:
    """Return each finished episode as the level it began on and its moves.

    Blocked moves, which the notation lacks, and those taken back are left out. Solved episodes are a
    `Solution`, others `Moves`. Raises: ExportError for a world that is not Sokoban.
    """
    world = _sokoban(story)
    blocks = []
    by_episode = story.by_episode()
    for episode in story.episodes:
        number, outcome = episode.measures.episode, episode.measures.outcome.value
        rows = by_episode[number]
        start = parse_levels(rows[0].measures.view)[0].start
        moves = to_lurd(start, (Action[row.action] for row in kept_steps(rows)))
        key = "Solution" if outcome == "solved" else "Moves"
        blocks.append(
            f"{rows[0].measures.view}\nTitle: {world.level_name}, episode {number}\n"
            f"Outcome: {outcome} after {len(rows)} steps\n{key}: {moves}"
        )
    return "\n\n".join(blocks) + "\n" if blocks else ""


def _episodes(numbers: list[int]) -> str:
    return f"Episodes: {' '.join(map(str, numbers)) or 'none began here'}"


def _sokoban(story: Story) -> World:
    if not isinstance(story.config.world, World):
        raise ExportError(
            f"session {story.config.session} is taught in {story.config.world.level_name}, which has no "
            "levels: export csv, parquet or minari"
        )
    return story.config.world
