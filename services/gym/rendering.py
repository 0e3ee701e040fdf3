"""What teachers see of an environment: plain text, or one PNG in text."""

import re
from base64 import b64encode
from io import BytesIO
from typing import Any

from services.gym.errors import GymError

PICTURE_PREFIX = "data:image/png;base64,"
VIEW_MAX = 32_768
"""Characters of a view on the wire."""
_BOARD = frozenset("#@+$*. -_\n")
_COLOUR = re.compile(r"\x1b\[([0-9;]*)m")
_LAST_ACTION = re.compile(r"^\s*\([A-Za-z ]+\)\s*$")
"""What toy-text environments print above or below the picture: part of the way here, not of the state."""


def is_board(view: str) -> bool:
    """Tell whether a view is a Sokoban board in XSB, and not what another world shows."""
    return "#" in view and set(view) <= _BOARD


def as_text(rendered: str) -> str:
    """Return an ANSI rendering as printable lines: what is coloured stands between marks instead.

    Background `[x]`, green background `(x)`, bold `<x>`, another colour `{x}`; with a background and a
    colour the first mark is the background's, the last the colour's. Where anything is marked, each
    character takes three columns, so that columns stay in line.
    """
    lines = [line.rstrip() for line in rendered.split("\n")]
    lines = [line for line in lines if not _LAST_ACTION.match(_COLOUR.sub("", line))]
    while lines and not lines[0].strip():
        del lines[0]
    while lines and not lines[-1].strip():
        del lines[-1]
    marked = any(_COLOUR.search(line) for line in lines)
    return "\n".join(_spread(line) if marked else _printable(line) for line in lines)


def _spread(line: str) -> str:
    cells: list[str] = []
    codes: list[int] = []
    at = 0
    for found in [*_COLOUR.finditer(line), None]:
        end = len(line) if found is None else found.start()
        opening, closing = _marks(codes)
        cells += [f"{opening}{char}{closing}" for char in _printable(line[at:end])]
        if found is not None:
            new = [int(code or 0) for code in found[1].split(";")]
            codes = [] if 0 in new else codes + new
            at = found.end()
    return "".join(cells).rstrip()


def _marks(codes: list[int]) -> tuple[str, str]:
    grounds = [code for code in codes if 40 <= code <= 47]
    ground = ("()" if 42 in grounds else "[]") if grounds else ""
    colour = "<>" if 1 in codes else "{}" if any(30 <= code <= 37 for code in codes) else ""
    return (ground or colour or "  ")[0], (colour or ground or "  ")[1]


def _printable(text: str) -> str:
    return "".join(char if char.isprintable() else " " for char in text)


def as_picture(pixels: Any) -> str:  # noqa: ANN401 - an array, if the environment keeps its word
    """Return uint8 pixels [height, width, 3] as a PNG in text. Raises: GymError when it is too large."""
    try:
        from PIL import Image  # noqa: PLC0415 - part of the extra
    except ImportError:
        raise GymError("pictures need Pillow: install sfid[gym]") from None
    image = Image.fromarray(pixels).convert("P", palette=Image.Palette.ADAPTIVE, colors=64)
    while True:
        out = BytesIO()
        image.save(out, "PNG", optimize=True)
        text = PICTURE_PREFIX + b64encode(out.getvalue()).decode()
        if len(text) <= VIEW_MAX:
            return text
        if min(image.size) < 64:
            raise GymError(f"a picture takes {len(text)} characters, {VIEW_MAX} fit: render it as text")
        image = image.resize((image.width // 2, image.height // 2))


def as_observed(observation: Any) -> str:  # noqa: ANN401 - environments observe what they like
    """Return an observation in words, or what an environment says of itself that cannot draw itself."""
    return "\n".join(_printable(line) for line in str(observation).split("\n"))
