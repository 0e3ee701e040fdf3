"""Capital letters, digits and signs in pixels, five high: names and numbers inside the monitor's pictures."""

import numpy as np
import numpy.typing as npt

HEIGHT = 5
_GLYPHS = {
    "A": ".#./#.#/###/#.#/#.#", "B": "##./#.#/##./#.#/##.", "C": ".##/#../#../#../.##",
    "D": "##./#.#/#.#/#.#/##.", "E": "###/#../##./#../###", "F": "###/#../##./#../#..",
    "G": ".##/#../#.#/#.#/.##", "H": "#.#/#.#/###/#.#/#.#", "I": "#/#/#/#/#",
    "J": "..#/..#/..#/#.#/.#.", "K": "#.#/#.#/##./#.#/#.#", "L": "#../#../#../#../###",
    "M": "#...#/##.##/#.#.#/#...#/#...#", "N": "#..#/##.#/#.##/#..#/#..#", "O": ".#./#.#/#.#/#.#/.#.",
    "P": "##./#.#/##./#../#..", "Q": ".##./#..#/#..#/#.#./.#.#", "R": "##./#.#/##./#.#/#.#",
    "S": ".##/#../.#./..#/##.", "T": "###/.#./.#./.#./.#.", "U": "#.#/#.#/#.#/#.#/###",
    "V": "#.#/#.#/#.#/#.#/.#.", "W": "#...#/#...#/#.#.#/##.##/#...#", "X": "#.#/#.#/.#./#.#/#.#",
    "Y": "#.#/#.#/.#./.#./.#.", "Z": "###/..#/.#./#../###", "0": "###/#.#/#.#/#.#/###",
    "1": ".#/##/.#/.#/.#", "2": "##./..#/.#./#../###", "3": "##./..#/.#./..#/##.",
    "4": "#.#/#.#/###/..#/..#", "5": "###/#../##./..#/##.", "6": ".##/#../###/#.#/###",
    "7": "###/..#/.#./.#./.#.", "8": "###/#.#/###/#.#/###", "9": "###/#.#/###/..#/##.",
    "-": ".../.../###/.../...", "_": ".../.../.../.../###", ".": "././././#", ",": "../../../.#/#.",
    ":": "./#/./#/.", "/": "..#/..#/.#./#../#..", "%": "#.#/..#/.#./#../#.#", "+": ".../.#./###/.#./...",
    "?": "##./..#/.#./.../.#.", "!": "#/#/#/./#", "(": ".#/#./#./#./.#", ")": "#./.#/.#/.#/#.",
    "[": "##/#./#./#./##", "]": "##/.#/.#/.#/##", "{": ".##/.#./#../.#./.##", "}": "##./.#./..#/.#./##.",
    "<": "..#/.#./#../.#./..#", ">": "#../.#./..#/.#./#..", "|": "#/#/#/#/#", "=": ".../###/.../###/...",
    "←": "..#../.#.../#####/.#.../..#..", "→": "..#../...#./#####/...#./..#..",
    "↑": "..#../.###./#.#.#/..#../..#..", "↓": "..#../..#../#.#.#/.###./..#..",
    "*": "#.#/.#./#.#/.../...", "#": "#.#/###/#.#/###/#.#", " ": "../../../../..",
}  # fmt: skip
_ART = {
    sign: np.array([[pixel == "#" for pixel in row] for row in art.split("/")])
    for sign, art in _GLYPHS.items()
}


def width_of(text: str) -> int:
    """Return the pixels that a text is wide, at scale 1."""
    return sum(_ART.get(sign, _ART["?"]).shape[1] + 1 for sign in text.upper())


def write(picture: npt.NDArray[np.uint8], text: str, at: tuple[int, int], colour: int, scale: int = 2) -> int:
    """Write a text into the picture, in place, cut at its right edge; return the column after it.

    Args: at: (row, column) of its upper left; colour: palette index; scale: pixels a pixel of the letters.
    """
    row, column = at
    for sign in text.upper():
        art = np.kron(_ART.get(sign, _ART["?"]), np.ones((scale, scale), bool))
        height, width = art.shape
        if column + width > picture.shape[1] or row + height > picture.shape[0]:
            break
        picture[row : row + height, column : column + width][art] = colour
        column += width + scale
    return column
