"""What the monitor shows, as plain data: the seam between what is computed and how Rerun is told."""

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
class Picture:
    """A whole picture with its arrows, logged in one call so that no viewer sees half of it."""

    entity: str
    moment: Moment
    png: bytes
    arrows: tuple[Arrow, ...] = ()


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
    """How often one teacher is right, as far as is known, with the standard error."""

    teacher: str
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
