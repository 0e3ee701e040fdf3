"""From messages to the picture of the world: which moment is shown for how long, and what is drawn."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from protocol.messages import Decision, SaidBy, Step
from services import tiles
from services.gym.rendering import is_board
from services.monitor.other_view import other_image
from services.monitor.rows import Arrow, Colour, Indexed, Moment, Picture
from sfid_core.sokoban.actions import Action
from sfid_core.sokoban.board import Board
from sfid_core.sokoban.levels import LevelError, parse_levels

ENTITY = "world"
AGENT_COLOUR: Colour = (255, 255, 255)
BUMPED_COLOUR: Colour = (255, 72, 72)
TEACHER_COLOURS: tuple[Colour, ...] = (
    # Okabe & Ito 2008, told apart by colour-blind people; without their black and their vermilion (bumped).
    (86, 180, 233),
    (230, 159, 0),
    (204, 121, 167),
    (240, 228, 66),
    (0, 178, 130),
    (90, 140, 255),
)
TEACHERS_REMEMBERED_MAX = 1024
NAMED_ARROWS_MAX = 3
"""Teachers of one direction with an arrow each; more are shown as one arrow with their number."""

NAME_HEIGHT = 0.55
"""Tiles from one name to the next."""

HOLD_S = 0.4
"""How long a step on which somebody answered stays in view: long enough to read a name."""


class ViewError(ValueError):
    """A view cannot be drawn; the text is one line."""


@lru_cache(maxsize=512)
def read_view(view: str) -> Board:
    """Return the board that an XSB view shows, solved or not. Raises ViewError."""
    # A blank row inside a level would end it; `-` is floor too.
    text = "\n".join(row if row.strip() else "-" + row[1:] for row in view.split("\n"))
    try:
        levels = parse_levels(text)
    except (LevelError, ValueError) as error:
        raise ViewError(str(error)) from None
    if len(levels) != 1:
        raise ViewError(f"the view holds {len(levels)} levels instead of one")
    return levels[0].start


@dataclass(frozen=True, slots=True)
class Frame:
    """One moment of the world."""

    moment: Moment
    view: str
    action: str | None = None
    bumped: bool = False
    said: tuple[SaidBy, ...] = ()
    hold_s: float = 0.0


def frames_of_step(step: Step, wall_ns: int | None) -> tuple[Frame, ...]:
    """Return the step as it was decided, and where an episode ended, the board it ended on."""
    held_s = HOLD_S if step.said else 0.0
    bumped = step.view == step.next_view
    moment = Moment(step.decision, wall_ns, step.episode)
    decided = Frame(moment, step.view, step.action, bumped, step.said, held_s)
    if step.outcome == "running":
        return (decided,)
    return decided, Frame(Moment(step.decision + 1, wall_ns, step.episode), step.next_view, hold_s=HOLD_S)


def frame_of_decision(decision: Decision, wall_ns: int | None) -> Frame:
    """Return the board a decision is taken on; the agent's action only once the learner tells it."""
    return Frame(Moment(decision.decision, wall_ns, decision.episode), decision.view, decision.action)


class Stage:
    """Which frame is shown: the newest, but answers and ends of episodes long enough to be seen.

    A step somebody answered is not overtaken by the decision that follows at once, only by newer such steps.
    """

    __slots__ = ("_free_at_s", "_held", "_newest")

    def __init__(self) -> None:
        self._held: deque[Frame] = deque(maxlen=2)
        self._newest: Frame | None = None
        self._free_at_s = 0.0

    def offer(self, frames: Sequence[Frame]) -> None:
        """Take the frames of one message, in order; older ones that were not shown yet give way."""
        held = [frame for frame in frames if frame.hold_s]
        if held:
            self._held.clear()
            self._held.extend(held)
            self._newest = None
        if not frames[-1].hold_s:
            self._newest = frames[-1]

    def due(self, now_s: float) -> Frame | None:
        """Return the frame to draw now, if there is one; each frame is returned once."""
        if self._held:
            held = self._held.popleft()
            self._free_at_s = now_s + held.hold_s
            return held
        if now_s < self._free_at_s:
            return None
        frame, self._newest = self._newest, None
        return frame

    def is_free(self, now_s: float) -> bool:
        """Tell whether nothing waits or is held: the open decision may be drawn again."""
        return not self._held and self._newest is None and now_s >= self._free_at_s


class TeacherColours:
    """A colour for each teacher, in the order in which they are first seen."""

    __slots__ = ("_numbers",)

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}

    def of(self, teacher: str) -> Colour:
        """Return the teacher's colour, the same for the whole session; the seventh shares the first's."""
        # Bounded, because a crowd may be of any size; beyond it people share the first colour.
        if teacher not in self._numbers and len(self._numbers) < TEACHERS_REMEMBERED_MAX:
            self._numbers[teacher] = len(self._numbers)
        return self.known(teacher)

    def known(self, teacher: str) -> Colour:
        """Return the colour without giving one to a stranger, who has the first."""
        return TEACHER_COLOURS[self._numbers.get(teacher, 0) % len(TEACHER_COLOURS)]


def draw_world(frame: Frame, colours: TeacherColours, share_left: float | None = None) -> Picture:
    """Return the picture of a frame. Raises ViewError.

    Args: share_left: how much of the open window is left, drawn as a bar along the upper edge.
    """
    if frame.view and not is_board(frame.view):
        other = other_image(frame.view)
        if other is None:
            raise ViewError("the view begins like a picture and holds none")
        return Picture(ENTITY, frame.moment, other)
    board = read_view(frame.view)
    indexes = tiles.background(board.level)
    tiles.draw_boxes(indexes, board)
    tiles.put(
        indexes, board.level, board.player, tiles.KEEPER.get(frame.action or "DOWN", tiles.KEEPER["DOWN"])
    )
    if share_left is not None:
        tiles.draw_count_down(indexes, share_left)
    image = Indexed(indexes, tiles.palette())
    return Picture(ENTITY, frame.moment, image, arrows_of(frame, board, colours))


def arrows_of(frame: Frame, board: Board, colours: TeacherColours) -> tuple[Arrow, ...]:
    """Return the agent's arrow and the teachers' beside it, side by side where directions agree."""
    lanes: dict[str, list[tuple[str, Colour]]] = {action.name: [] for action in Action}
    if frame.action in lanes:
        lanes[frame.action].append(("", BUMPED_COLOUR if frame.bumped else AGENT_COLOUR))
    for action, items in lanes.items():
        items.extend(_teachers_towards(action, frame, colours))
    row, column = divmod(board.player, board.level.width)
    centre = ((column + 0.5) * tiles.TILE, (row + 0.5) * tiles.TILE)
    return tuple(
        arrow
        for action, items in lanes.items()
        for arrow in _side_by_side(Action[action].delta, items, centre)
    )


def _teachers_towards(action: str, frame: Frame, colours: TeacherColours) -> list[tuple[str, Colour]]:
    """Name and colour of everybody whose answer points this way; a reward points where the agent went."""
    items = [(said.teacher, colours.of(said.teacher)) for said in frame.said if said.action == action]
    if action == frame.action:
        rewards = ((said.teacher, said.reward) for said in frame.said if said.reward is not None)
        items += [(f"{teacher} {reward:+g}", colours.of(teacher)) for teacher, reward in rewards]
    if len(items) > NAMED_ARROWS_MAX:
        return [(f"{len(items)} teachers", TEACHER_COLOURS[0])]
    return items


def _side_by_side(
    delta: tuple[int, int], items: Sequence[tuple[str, Colour]], centre: tuple[float, float]
) -> list[Arrow]:
    down, right = delta
    arrows, named = [], 0
    for number, (label, colour) in enumerate(items):
        aside = 0.3 * tiles.TILE * (number - (len(items) - 1) / 2)
        start = 0.5 * tiles.TILE
        origin = (centre[0] + right * start + down * aside, centre[1] + down * start + right * aside)
        vector = (right * 0.75 * tiles.TILE, down * 0.75 * tiles.TILE)
        arrows.append(Arrow(origin, vector, colour))
        if label:
            arrows.append(_name(label, colour, (right, down), centre, named))
            named += 1
    return arrows


def _name(
    label: str, colour: Colour, towards: tuple[int, int], centre: tuple[float, float], before: int
) -> Arrow:
    """Return a text where it covers neither the agent nor an arrow: beyond those up or down, above others.

    Args: before: how many names stand there already; each is beyond the one before it.
    A viewer writes an arrow's label a little below its middle; this arrow is nothing but its label.
    """
    right, down = towards
    x = centre[0] + 0.875 * right * tiles.TILE
    beyond = NAME_HEIGHT * before * (down or -1)
    y = centre[1] + ((1.7 * down if down else -0.95) - 0.35 + beyond) * tiles.TILE
    return Arrow((x, y), (0.0, 0.0), colour, label, width=0.0)
