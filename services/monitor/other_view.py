"""Pictures of worlds that are no Sokoban: their text, letter by letter, or the picture that they sent."""

from base64 import b64decode
from binascii import Error

import numpy as np

from services import tiles
from services.gym.rendering import PICTURE_PREFIX
from services.monitor import font
from services.monitor.rows import Indexed

PITCH, LINE, SCALE, MARGIN = 5, 9, 3, 12
"""Pixels of the letters from one to the next, and from line to line; pixels a pixel at most; around all."""
PNG = b"\x89PNG\r\n\x1a\n"
SIDE_MAX = 128
"""Columns and lines that are drawn; what is beyond is cut."""
LARGE = 64
"""Columns or lines, times the scale, up to which letters are enlarged: a picture is raw pixels to viewers."""


def other_image(view: str) -> Indexed | bytes | None:
    """Return the picture of a view that is no board, None where it holds none."""
    if not view.startswith(PICTURE_PREFIX):
        return _written([line[:SIDE_MAX] for line in view.split("\n")[:SIDE_MAX]])
    try:
        png = b64decode(view.removeprefix(PICTURE_PREFIX), validate=True)
    except (Error, ValueError):
        return None
    return png if png.startswith(PNG) else None


def _written(lines: list[str]) -> Indexed:
    columns = max(map(len, lines), default=0)
    scale = max(1, min(SCALE, LARGE // max(1, columns, len(lines))))
    shape = len(lines) * LINE * scale + 2 * MARGIN, columns * PITCH * scale + 2 * MARGIN
    picture = np.full(shape, tiles.colour_number("_"), np.uint8)
    for row, line in enumerate(lines):
        for column, sign in enumerate(line):
            at = MARGIN + row * LINE * scale, MARGIN + column * PITCH * scale
            colour = "g" if sign in "[](){}<>" else "n"
            font.write(picture, sign, at, tiles.colour_number(colour), scale)
    return Indexed(picture, tiles.palette())
