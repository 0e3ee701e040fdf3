"""The pixel art of the board: drawn here as text, 16 x 16 pixels a tile, one shared palette.

A picture is an array of palette indexes. Index 0 is the space outside the walls; a `.` of a sprite
is transparent.
"""

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from sfid_core.sokoban.board import Board, Level

Indexes = npt.NDArray[np.uint8]

TILE = 16
"""Pixels a cell, each way."""

COUNT_DOWN = 3
"""Pixels that the bar of the count-down is high."""

COLOURS = {
    "_": "#0b0d12",  # outside
    "f": "#3a3542",  # floor
    "F": "#423c4b",  # floor, lit edge
    "u": "#332e3a",  # floor, seam
    "U": "#26222c",  # floor, shadow of a wall
    "t": "#7d8aa5",  # wall, top
    "T": "#94a2be",  # wall, lit edge
    "j": "#69758f",  # wall, joint
    "q": "#4b5570",  # wall, front
    "Q": "#3b435a",  # wall, joint of the front
    "g": "#f2c14e",  # goal
    "G": "#b98a2b",  # goal, heart
    "o": "#2b1a10",  # outline of wood
    "w": "#c68642",  # wood
    "W": "#e8b06a",  # wood, lit
    "d": "#8f5a2a",  # wood, shaded
    "n": "#f7e3c3",  # nail
    "p": "#0f2e22",  # outline of a box at home
    "h": "#3fb27f",  # home
    "H": "#7fe0b4",  # home, lit
    "e": "#24785a",  # home, shaded
    "c": "#ffffff",  # tick of a box at home
    "k": "#15131a",  # outline of the keeper, eyes, shoes
    "r": "#e4572e",  # cap
    "R": "#b23a1a",  # cap, brim
    "s": "#f6c9a0",  # skin
    "S": "#d99f72",  # skin, shaded
    "b": "#4f7cd6",  # dungarees
    "B": "#375aa6",  # dungarees, shaded
    "y": "#ffe27a",  # buttons
    "m": "#6b4226",  # hair
}
VALUE_COLOURS = 32
"""Steps of the ramp from the lowest value shown to the highest."""

_NUMBERS = {letter: index for index, letter in enumerate(COLOURS)}
DIMMED = len(COLOURS)
"""Index of the first dimmed colour: index + DIMMED is the same colour, darker."""
VALUES = 2 * len(COLOURS)
"""Index of the lowest value's colour."""

_BOX = """
................
.oooooooooooooo.
.oWWWWWWWWWWWWo.
.oWnwwwwwwwwndo.
.oWddddddddddoo.
.oWwwwwwwwwwwdo.
.oWwwwwwwwwwwdo.
.oWddddddddddoo.
.oWwwwwwwwwwwdo.
.oWwwwwwwwwwwdo.
.oWddddddddddoo.
.oWwwwwwwwwwwdo.
.oWnwwwwwwwwndo.
.oddddddddddddo.
.oooooooooooooo.
................
"""
_TICK = """
................
................
................
................
...........cc...
..........cc....
.........ccc....
...c....ccc.....
...cc..ccc......
...ccccccc......
....ccccc.......
.....ccc........
......c.........
................
................
................
"""
_GOAL = """
................
................
.......gg.......
......g..g......
.....g....g.....
....g......g....
...g...GG...g...
..g...GggG...g..
..g...GggG...g..
...g...GG...g...
....g......g....
.....g....g.....
......g..g......
.......gg.......
................
................
"""
_FRONT = """
................
.....kkkkkk.....
....krrrrrrk....
...krrrrrrrrk...
...kRRRRRRRRk...
...kmsssssssk...
...ksskssksSk...
...ksssssssSk...
....kssSSssk....
...kbyksskybk...
..kskbbbbbbksk..
..kskbbyybbksk..
...kkbbbbbbkk...
....kbBkkBbk....
....kkk..kkk....
................
"""
_BACK = """
................
.....kkkkkk.....
....krrrrrrk....
...krrrrrrrrk...
...krrrrrrrrk...
...kmmmmmmmmk...
...kmmmmmmmmk...
...kSmmmmmmSk...
....kSSSSSSk....
...kbbbkkbbbk...
..kskbbbbbbksk..
..kskbbBBbbksk..
...kkbbbbbbkk...
....kbBkkBbk....
....kkk..kkk....
................
"""
_LEFTWARD = """
................
.....kkkkkk.....
....krrrrrrk....
...krrrrrrrrk...
.kkRRRRRRrrrk...
...kssssmmmmk...
...kskssmmmmk...
..ksssssSmmk....
...kksSSSkk.....
....kkbbbbk.....
....kbysSbbk....
....kbbsSbbk....
....kbbkkbbk....
....kbbbBBBk....
....kkkkkkkk....
................
"""

Sprite = tuple[Indexes, npt.NDArray[np.bool_]]
"""Palette indexes (16, 16), and where the sprite covers what is below it."""


def _sprite(art: str, recolour: dict[str, str] | None = None) -> Sprite:
    letters = [[(recolour or {}).get(letter, letter) for letter in row] for row in art.split()]
    indexes = np.array([[_NUMBERS.get(letter, 0) for letter in row] for row in letters], np.uint8)
    return indexes, np.array([[letter != "." for letter in row] for row in letters])


def _mirrored(sprite: Sprite) -> Sprite:
    return sprite[0][:, ::-1], sprite[1][:, ::-1]


def _stacked(below: Sprite, above: Sprite) -> Sprite:
    return np.where(above[1], above[0], below[0]), below[1] | above[1]


BOX = _sprite(_BOX)
BOX_AT_HOME = _stacked(_sprite(_BOX, {"o": "p", "w": "h", "W": "H", "d": "e", "n": "H"}), _sprite(_TICK))
GOAL = _sprite(_GOAL)
KEEPER = {
    "LEFT": _sprite(_LEFTWARD),
    "RIGHT": _mirrored(_sprite(_LEFTWARD)),
    "UP": _sprite(_BACK),
    "DOWN": _sprite(_FRONT),
}
"""The player by the direction it faces."""


def colour_number(letter: str) -> int:
    """Return the palette index of a colour by its letter in `COLOURS`."""
    return _NUMBERS[letter]


def palette() -> npt.NDArray[np.uint8]:
    """Return the shared palette, uint8 (colours, 3): the colours, the same dimmed, the ramp of values."""
    bright = np.array([[int(colour[at : at + 2], 16) for at in (1, 3, 5)] for colour in COLOURS.values()])
    # Stops of the ramp: night blue, blue, sea green, leaf green, sunlight; its lightness rises all the way.
    stops = np.array([(28, 30, 74), (40, 80, 140), (38, 138, 134), (122, 190, 84), (252, 226, 92)])
    at = np.linspace(0, len(stops) - 1, VALUE_COLOURS)
    ramp = np.stack([np.interp(at, range(len(stops)), stops[:, channel]) for channel in range(3)], axis=1)
    return np.concatenate([bright, bright * 0.55, ramp]).round().astype(np.uint8)


def cell_view(picture: Indexes, level: Level, cell: int) -> Indexes:
    """Return the (16, 16) part of the picture that shows the cell, to be drawn into."""
    row, column = divmod(cell, level.width)
    return picture[row * TILE : (row + 1) * TILE, column * TILE : (column + 1) * TILE]


def put(picture: Indexes, level: Level, cell: int, sprite: Sprite) -> None:
    """Draw the sprite over the cell, in place."""
    np.copyto(cell_view(picture, level, cell), sprite[0], where=sprite[1])


def draw_boxes(picture: Indexes, board: Board) -> None:
    """Draw the boxes where they stand, in place; one on a goal is green with a tick."""
    for box in board.boxes:
        put(picture, board.level, box, BOX_AT_HOME if box in board.level.goal_set else BOX)


def draw_count_down(picture: Indexes, share: float) -> None:
    """Draw what is left of the window along the upper edge, in place; red in its last quarter."""
    width = picture.shape[1]
    picture[: COUNT_DOWN + 2] = _NUMBERS["_"]
    picture[1 : COUNT_DOWN + 1, : round(width * share)] = _NUMBERS["r" if share < 0.25 else "h"]


def background(level: Level) -> Indexes:
    """Return walls, floor and goals as a fresh picture, uint8 (height * 16, width * 16)."""
    return _background(level.width, level.height, level.walls, level.reach, level.goals).copy()


@lru_cache(maxsize=32)
def _background(
    width: int, height: int, walls: frozenset[int], floor: tuple[int, ...], goals: tuple[int, ...]
) -> Indexes:
    picture = np.zeros((height * TILE, width * TILE), np.uint8)

    def part(cell: int) -> Indexes:
        row, column = divmod(cell, width)
        return picture[row * TILE : (row + 1) * TILE, column * TILE : (column + 1) * TILE]

    for cell in walls:
        part(cell)[:] = _wall(cell, shows_front=cell + width not in walls)
    for cell in floor:
        part(cell)[:] = _floor(cell, below_wall=cell - width in walls, beside_wall=cell - 1 in walls)
    for cell in goals:
        np.copyto(part(cell), GOAL[0], where=GOAL[1])
    return picture


def _wall(cell: int, *, shows_front: bool) -> Indexes:
    """One block of wall from above; where nothing stands before it, its lower third is the front."""
    tile = np.full((TILE, TILE), _NUMBERS["t"], np.uint8)
    tile[0], tile[:, 0] = _NUMBERS["T"], _NUMBERS["T"]
    tile[-1], tile[:, -1] = _NUMBERS["j"], _NUMBERS["j"]
    for row, column in _specks(cell, 3):
        tile[row, column : column + 2] = _NUMBERS["j"]
    if shows_front:
        tile[9], tile[10:] = _NUMBERS["T"], _NUMBERS["q"]
        tile[12], tile[15] = _NUMBERS["Q"], _NUMBERS["Q"]
        tile[10:12, 7], tile[13:15, 3], tile[13:15, 11] = _NUMBERS["Q"], _NUMBERS["Q"], _NUMBERS["Q"]
    return tile


def _floor(cell: int, *, below_wall: bool, beside_wall: bool) -> Indexes:
    tile = np.full((TILE, TILE), _NUMBERS["f"], np.uint8)
    tile[0], tile[:, 0] = _NUMBERS["F"], _NUMBERS["F"]
    tile[-1], tile[:, -1] = _NUMBERS["u"], _NUMBERS["u"]
    for row, column in _specks(cell, 2):
        tile[row, column] = _NUMBERS["u"]
    if below_wall:
        tile[:3] = _NUMBERS["U"]
    if beside_wall:
        tile[:, :2] = _NUMBERS["U"]
    return tile


def _specks(cell: int, count: int) -> list[tuple[int, int]]:
    """Return places inside a tile that look scattered but are always the same (a multiplicative hash)."""
    mixed = [((cell * 8 + number + 1) * 2_654_435_761) % 2**32 >> 16 for number in range(count)]
    return [(2 + value % 7, 2 + (value >> 5) % 11) for value in mixed]
