"""Figures into files whose bytes depend on the figure alone: no date, no random names."""

import io
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure

from services.plots.model import PlotError
from services.plots.style import SETTINGS

DOTS_PER_INCH = 300
"""What journals ask for; 3.5 inches are 1,050 pixels."""


def save(figure: Figure, stem: Path, description: str) -> tuple[Path, Path]:
    """Write the figure as PNG and SVG and return the two files.

    Args: stem: the path without an ending; description: what is seen, for those who do not see it; it is
    kept in both files.  Raises: PlotError.
    """
    written = []
    for ending, metadata in (
        ("png", {"Title": stem.name, "Description": description, "Software": None}),
        ("svg", {"Title": stem.name, "Description": description, "Date": None}),
    ):
        content = io.BytesIO()
        with rc_context(SETTINGS):
            figure.savefig(content, format=ending, dpi=DOTS_PER_INCH, metadata=metadata)
        written.append(_put(stem.with_name(f"{stem.name}.{ending}"), content.getvalue()))
    return written[0], written[1]


def _put(path: Path, content: bytes) -> Path:
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(content)
        return part.replace(path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise PlotError(f"cannot write {path}: {reason}; give a place you may write to") from error
