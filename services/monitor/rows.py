"""What the monitor shows, as plain data: the seam between what is computed and how Rerun is told."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Colour = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Moment:
    """When a row happened, on the three timelines."""

    step: int
    """Steps of the session so far; the timeline that everything is on."""
    wall_ns: int | None = None
    """Nanoseconds since 1970-01-01 UTC, by the learner's clock; None where no message has told."""
    episode: int | None = None
    """Number of the episode, from 0; None where no message has told."""


@dataclass(frozen=True, slots=True)
class Arrow:
    """One arrow over a picture, in its pixels: x to the right, y downwards."""

    origin: tuple[float, float]
    vector: tuple[float, float]
    colour: Colour
    label: str = ""
    width: float = 3.2
    opacity: float = 1.0


@dataclass(frozen=True, slots=True)
class Indexed:
    """A picture by palette; all pictures of an entity share one."""

    indexes: npt.NDArray[np.uint8]
    """(height, width), each below the number of colours; not written to any more."""
    palette: npt.NDArray[np.uint8]
    """(1 to 256, 3), RGB."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A whole picture with its arrows, logged in one call so that no viewer sees half of it."""

    entity: str
    moment: Moment
    image: Indexed | bytes
    """By palette, or a PNG as an environment sent it: viewers show a palette's at once, and a PNG once they
    have decoded it, which a slow one has not done when the next one comes."""
    arrows: tuple[Arrow, ...] = ()
    lanes: tuple["Lane", ...] = ()
    """What was said at this moment, for viewers: the lanes themselves come later, in batches, and the strip
    below a board would tell of earlier steps than the board."""


@dataclass(frozen=True, slots=True)
class Curves:
    """Rows of one or more curves that share an entity."""

    entity: str
    moments: tuple[Moment, ...]
    values: npt.NDArray[np.float64]
    """(rows, curves); NaN where a curve has no value."""


@dataclass(frozen=True, slots=True)
class Lane:
    """What one teacher said, as stretches of a lane; an empty state ends a stretch."""

    teacher: str
    moments: tuple[Moment, ...]
    states: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Reliabilities:
    """How reliable one teacher is, by others' labels or their aggregator, with the standard error."""

    teacher: str
    label: str
    """What the legend calls the curve."""
    colour: Colour
    moments: tuple[Moment, ...]
    means: tuple[float, ...]
    errors: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Events:
    """Lines of the event log."""

    moments: tuple[Moment, ...]
    texts: tuple[str, ...]
    levels: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Document:
    """A text in Markdown; the newest is shown."""

    entity: str
    moment: Moment
    markdown: str


Row = Picture | Curves | Lane | Reliabilities | Events | Document


@dataclass(slots=True)
class Rows:
    """Rows that belong together: pictures for the chatty server, the rest for the one with a long history."""

    scene: list[Picture] = field(default_factory=list)
    curves: list[Row] = field(default_factory=list)


def merged(rows: Iterable[Row]) -> list[Row]:
    """Return the same rows in fewer batches: one for each curve, lane and the event log, in their order.

    Rerun keeps a kilobyte about each batch as long as the file is open, whatever is in it.
    """
    batches: dict[tuple[type, str], list[Row]] = {}
    for number, row in enumerate(rows):
        match row:
            case Curves(entity):
                key = entity
            case Lane(teacher):
                key = teacher
            case Reliabilities(teacher, label):
                key = f"{teacher} {label}"
            case Events():
                key = ""
            case _:  # each stands for itself
                key = str(number)
        batches.setdefault((type(row), key), []).append(row)
    return [_one(batch) for batch in batches.values()]


def _one(batch: list[Row]) -> Row:
    match batch[0]:
        case first if len(batch) == 1:
            return first
        case Curves(entity):
            curves = [row for row in batch if isinstance(row, Curves)]
            return Curves(entity, _moments(curves), np.concatenate([row.values for row in curves]))
        case Lane(teacher):
            lanes = [row for row in batch if isinstance(row, Lane)]
            return Lane(teacher, _moments(lanes), tuple(state for row in lanes for state in row.states))
        case Reliabilities(teacher, label, colour):
            known = [row for row in batch if isinstance(row, Reliabilities)]
            means = tuple(mean for row in known for mean in row.means)
            errors = tuple(error for row in known for error in row.errors)
            return Reliabilities(teacher, label, colour, _moments(known), means, errors)
        case _:
            events = [row for row in batch if isinstance(row, Events)]
            texts = tuple(text for row in events for text in row.texts)
            levels = tuple(level for row in events for level in row.levels)
            return Events(_moments(events), texts, levels)


def _moments(batch: Iterable[Curves | Lane | Reliabilities | Events]) -> tuple[Moment, ...]:
    return tuple(moment for row in batch for moment in row.moments)
