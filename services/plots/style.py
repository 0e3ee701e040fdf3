"""How figures look: colours that everybody can tell apart, and a second sign for each of them."""

from typing import Any, NamedTuple

HUES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#222222")
"""The colours of Okabe & Ito (2008), which people with any colour vision tell apart; yellow, too pale for
lines on white, is left out."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DASHES: tuple[Any, ...] = ("solid", (0, (3.2, 1.4)), (0, (1, 1.1)), (0, (4, 1.2, 1, 1.2)))
INK, MUTED, FAINT = "#222222", "#6b6b6b", "#e4e4e4"

SETTINGS: Any = {  # typed by matplotlib key by key, and matplotlib is not imported here
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same letters on every machine
    "font.size": 7,
    "axes.titlesize": 7.5,
    "axes.labelsize": 7,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "legend.fontsize": 7,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.titlelocation": "left",
    "axes.titlepad": 4,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.5,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.size": 2.2,
    "ytick.major.size": 2.2,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.pad": 2,
    "ytick.major.pad": 2,
    "legend.frameon": False,
    "legend.handlelength": 2.9,
    "legend.columnspacing": 1.6,
    "legend.labelspacing": 0.35,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.hashsalt": "sfid",  # without it, names inside an SVG are drawn at random
    "svg.fonttype": "path",
}


class Look(NamedTuple):
    """How one line is drawn."""

    color: str
    marker: str
    dash: Any
    width: float
    above: float
    """Drawing order: larger is on top."""


def look(hue: int, dash: int) -> Look:
    """Return the look of a line. Later hues are wider and lie beneath, so that equal curves both show."""
    return Look(
        color=HUES[hue % len(HUES)],
        marker=MARKERS[hue % len(MARKERS)],
        dash=DASHES[dash % len(DASHES)],
        width=1.0 + 0.6 * min(hue, 2),
        above=3 - 0.1 * hue - 0.01 * dash,
    )
