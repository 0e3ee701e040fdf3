"""All sessions at a glance: a card for each, with board, progress, agreement, who is there, who is stuck."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan

import numpy as np
import numpy.typing as npt

from protocol.messages import Decision
from services import tiles
from services.monitor import font
from services.monitor.rows import Colour, Indexed, Moment, Picture
from services.monitor.scene import TEACHER_COLOURS, ViewError, read_view
from services.monitor.session_view import SessionView
from services.monitor.status import counted
from sfid_core.sokoban.board import Board

ENTITY = "sessions"
PERIOD_S = 2.0
"""Seconds between two pictures, times the sessions that are watched."""
SHOWN_MAX = 16
CARD_HEIGHT, CARD_WIDTH, GAP = 136, 276, 8
LINE_HEIGHT = 16
BOARD_SIDE = 84
NAMES_MAX = 3
UNANSWERED_S = 60.0
SILENT_S = 20.0
LOST_EPISODES = 5
KEY = (("r", "agent"), ("w", "box"), ("g", "goal"), ("h", "box on goal"))
"""What stands on the small boards: colour, and its name."""
DOTTED = "dotted: fewest steps to solve"
HINT = "another session: the first square top right lists them"
"""The viewer's list of recordings is closed at first: with one session it shows nothing."""

PANEL, LINE, TEXT, MUTED, GOOD, BAD, WAIT, STEPS, AGREE = range(9)
_COLOURS: tuple[Colour, ...] = (
    (24, 27, 36), (52, 58, 74), (236, 240, 248), (138, 148, 170), (80, 200, 130),
    (255, 92, 84), (250, 190, 60), (120, 190, 255), (70, 210, 200),
)  # fmt: skip
_BASE = len(tiles.palette())
_TEACHERS = {colour: _BASE + len(_COLOURS) + number for number, colour in enumerate(TEACHER_COLOURS)}
_PALETTE = np.concatenate([tiles.palette(), np.array([*_COLOURS, *TEACHER_COLOURS], np.uint8)])
Indexes = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Glance:
    """What a card shows of one session."""

    session: str
    view: str
    state: str
    stuck: bool
    begun: bool
    episode: int
    episodes: int
    steps: tuple[int, ...]
    """Of the latest episodes."""
    fewest: int | None
    solved: bool
    agreement: float
    teachers: tuple[tuple[str, Colour], ...]
    present: int


def glance(session: str, view: SessionView, now_s: float) -> Glance:
    """Return how a session stands."""
    state, stuck = _standing(view, now_s)
    decision, report = view.decision, view.report
    names = () if decision is None else decision.teachers
    episode = decision.episode if decision else report.summary.episode if report else 0
    episodes = decision.episodes if decision else report.summary.episodes if report else 0
    return Glance(
        session, view.view, state, stuck, view.has_begun, episode, episodes,
        tuple(each.steps for each in view.recent),
        view.recent[-1].optimal_steps if view.recent else None,
        bool(view.recent) and view.recent[-1].outcome == "solved",
        view.chronicle.agreement.share(),
        tuple((name, view.chronicle.colours.known(name)) for name in names[:NAMES_MAX]),
        0 if decision is None else decision.teachers_present,
    )  # fmt: skip


def _standing(view: SessionView, now_s: float) -> tuple[str, bool]:
    """Return the state of a session in a few words, and whether somebody should look after it."""
    decision, waited_s = view.decision, now_s - view.decided_s
    if view.is_finished:
        return "finished", False
    if decision is None:
        return "not heard yet", False
    if decision.paused:
        return "paused", False
    trouble = _trouble(view, decision, waited_s)
    return trouble or ("teaching" if decision.teachers_present else "running alone"), bool(trouble)


def _trouble(view: SessionView, decision: Decision, waited_s: float) -> str:
    """Return in a few words why somebody should look after a session that goes on, if somebody should."""
    if decision.phase == "gathering":
        return "waiting for teachers"
    if decision.phase == "asking" and decision.remaining_ms is None and not decision.teachers_present:
        return "nobody to answer"
    if decision.phase == "asking" and waited_s > UNANSWERED_S:
        return f"no step for {_span(waited_s)}"
    if decision.phase != "asking" and waited_s > SILENT_S:
        return f"silent for {_span(waited_s)}"
    latest = [episode.outcome for episode in view.recent][-LOST_EPISODES:]
    lost = len(latest) == LOST_EPISODES and "solved" not in latest
    return f"{LOST_EPISODES} episodes unsolved" if lost else ""


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def draw_overview(glances: Sequence[Glance], moment: Moment, unshown: int = 0) -> Picture:
    """Return the cards of the sessions, those that need somebody first, and below how to watch another.

    Args: unshown: how many more go on that are not watched, which a line below says.
    """
    ordered = sorted(glances, key=lambda each: (not each.stuck, each.state == "finished", each.session))
    shown = ordered[:SHOWN_MAX]
    columns = 1 if len(shown) == 1 else 2 if len(shown) <= 4 else 3 if len(shown) <= 9 else 4
    rows = -(-len(shown) // columns)
    below = [DOTTED] * any(each.fewest is not None for each in shown) + [HINT] * (len(glances) > 1)
    below += [f"and {unshown} more that are not shown"] * (unshown > 0)
    height, width = rows * (CARD_HEIGHT + GAP) + GAP, columns * (CARD_WIDTH + GAP) + GAP
    canvas = np.zeros((height + (1 + len(below)) * LINE_HEIGHT, width), np.uint8)
    for number, each in enumerate(shown):
        top = GAP + number // columns * (CARD_HEIGHT + GAP)
        left = GAP + number % columns * (CARD_WIDTH + GAP)
        _draw_card(canvas[top : top + CARD_HEIGHT, left : left + CARD_WIDTH], each)
    _draw_key(canvas[height : height + LINE_HEIGHT, GAP:])
    for number, line in enumerate(below, 1):
        font.write(canvas, line, (height + number * LINE_HEIGHT, GAP), _BASE + MUTED)
    return Picture(ENTITY, moment, Indexed(canvas, _PALETTE))


def _draw_card(card: Indexes, each: Glance) -> None:
    colour = _BASE + (BAD if each.stuck else MUTED if each.state == "finished" else GOOD)
    card[:] = _BASE + PANEL
    card[0], card[-1], card[:, 0], card[:, -1] = (_BASE + LINE,) * 4
    card[:, :4] = colour
    font.write(card[:, :-8], each.session, (8, 12), _BASE + TEXT)
    badge = font.width_of(each.state) * 2
    font.write(card, each.state, (CARD_HEIGHT - 18, max(12, CARD_WIDTH - badge - 8)), colour)
    _draw_board(card[26 : 26 + BOARD_SIDE, 12 : 12 + BOARD_SIDE], each.view)
    side = card[:, BOARD_SIDE + 24 : -10]
    progress = f"episode {min(each.episode + 1, each.episodes)} of {each.episodes}"
    if not each.begun:
        progress = f"not begun, {counted(each.episodes, 'episode')}" if each.episodes else ""
    font.write(side, progress, (26, 0), _BASE + MUTED, 1)
    _draw_bar(side[34:40], min(1.0, each.episode / max(1, each.episodes)), _BASE + GOOD)
    font.write(side, _steps(each), (46, 0), _BASE + STEPS, 1)
    _draw_line(side[54:82], each.steps, each.fewest)
    share = "-" if isnan(each.agreement) else f"{each.agreement:.0%}"
    font.write(side, f"labels that agree {share}", (88, 0), _BASE + AGREE, 1)
    _draw_bar(side[96:102], 0.0 if isnan(each.agreement) else each.agreement, _BASE + AGREE)
    _draw_teachers(card[CARD_HEIGHT - 20 : CARD_HEIGHT - 6, 12 : BOARD_SIDE + 24], each)


def _steps(each: Glance) -> str:
    """Of the last episode: beside one that was not solved, fewer steps than the fewest would be a riddle."""
    if not each.steps:
        return "no episode done"
    fewest = "" if each.fewest is None else f", fewest {each.fewest}"
    return f"steps {each.steps[-1]}{fewest if each.solved else ', unsolved'}"


def _draw_key(part: Indexes) -> None:
    column = 0
    for letter, name in KEY:
        part[1:9, column : column + 8] = tiles.colour_number(letter)
        column = font.write(part, name, (0, column + 12), _BASE + MUTED) + 16


def _draw_board(part: Indexes, view: str) -> None:
    """The board in small, as large as it fits."""
    try:
        board = read_view(view)
    except ViewError:
        return
    level = board.level
    scale = max(1, min(part.shape[0] // level.height, part.shape[1] // level.width))
    big = _small(board, scale)[: part.shape[0], : part.shape[1]]
    top, left = (part.shape[0] - big.shape[0]) // 2, (part.shape[1] - big.shape[1]) // 2
    part[top : top + big.shape[0], left : left + big.shape[1]] = big


def _small(board: Board, scale: int) -> Indexes:
    """Every cell in its colour, and what stands on it a little smaller: a goal is seen below the agent."""
    level = board.level
    colour = tiles.colour_number
    cells = np.full(level.width * level.height, _BASE + PANEL, np.uint8)
    cells[sorted(level.walls)] = colour("q")
    cells[list(level.reach)] = colour("f")
    cells[list(level.goals)] = colour("g")
    big = np.kron(cells.reshape(level.height, level.width), np.ones((scale, scale), np.uint8))
    edge = 0 if scale < 4 else max(1, scale // 5)
    standing = [(box, "h" if box in level.goal_set else "w") for box in board.boxes]
    for cell, letter in (*standing, (board.player, "r")):
        row, column = (scale * at for at in divmod(cell, level.width))
        big[row + edge : row + scale - edge, column + edge : column + scale - edge] = colour(letter)
    return big


def _draw_bar(part: Indexes, share: float, colour: int) -> None:
    part[:] = _BASE + LINE
    part[:, : round(part.shape[1] * share)] = colour


def _draw_line(part: Indexes, steps: Sequence[int], fewest: int | None) -> None:
    """Steps of the latest episodes as columns, the newest to the right; the fewest possible as a line."""
    height, width = part.shape
    part[-1] = _BASE + LINE
    if not steps:
        return
    shown = steps[-(width // 2) :]
    top = max(*shown, fewest or 0, 1)
    for number, count in enumerate(shown):
        column = number * 2
        part[height - max(1, round(count / top * (height - 1))) :, column : column + 1] = _BASE + STEPS
    if fewest:
        part[height - 1 - round(fewest / top * (height - 1)), ::2] = _BASE + MUTED


def _draw_teachers(part: Indexes, each: Glance) -> None:
    """Who is present, each with their colour; who finds no room is a number."""
    if not each.present:
        font.write(part, "nobody present", (4, 0), _BASE + MUTED, 1)
        return
    column = shown = 0
    for name, colour in each.teachers:
        width = 8 + font.width_of(name[:8]) + 6
        if column + width > part.shape[1] - (24 if each.present > shown + 1 else 0):
            break
        part[4:9, column : column + 5] = _TEACHERS[colour]
        font.write(part, name[:8], (4, column + 8), _BASE + TEXT, 1)
        column, shown = column + width, shown + 1
    if each.present > shown:
        font.write(part, f"+{each.present - shown}", (4, column), _BASE + MUTED, 1)
