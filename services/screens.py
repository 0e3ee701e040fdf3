"""What a person at the browser page is shown, step by step: screens as data, and the flow that chooses them.

The gateway shows whatever a Flow says and hands back what the person did there, and knows
nothing of studies. A study is a Flow: consent, practice, teaching, questionnaire and completion are screens
with names of its own.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

Value = bool | int | float | str | None
"""What a person may fill into a field; None where nothing was filled in."""

FINISHED = "finished"
"""The button that nobody presses: the session of a teaching screen has come to its end."""


class FieldKind(Enum):
    """How a field is filled in, and what its value is."""

    CHECK = "check"
    """A box to tick: bool."""
    CHOICE = "choice"
    """One of `choices`: str."""
    SCALE = "scale"
    """A slider from `low` to `high` in steps of `step`, empty until touched: float."""
    NUMBER = "number"
    """A number from `low` to `high`: float."""
    TEXT = "text"
    """Free text of at most `length_max` characters: str."""


@dataclass(frozen=True, slots=True)
class Field:
    """One thing to fill in. Its value is None when it was left empty, which a required field may not be."""

    name: str
    kind: FieldKind
    label: str
    required: bool = True
    help: str = ""
    choices: tuple[str, ...] = ()
    low: float = 0.0
    high: float = 100.0
    step: float = 1.0
    low_label: str = ""
    high_label: str = ""
    length_max: int = 1000


@dataclass(frozen=True, slots=True)
class Button:
    """Something to press. `fills`: the fields must be filled in first, and their values come along."""

    name: str
    label: str
    fills: bool = True
    danger: bool = False
    """Whether the page asks once more before it counts, with `confirm` as the question."""
    confirm: str = ""


@dataclass(frozen=True, slots=True)
class Screen:
    """One screen. With a `session` the person teaches that session here; otherwise it is a page to read."""

    name: str
    """Name of the step in the flow: 1 to 48 of a-z, 0-9, - and _."""
    title: str = ""
    text: tuple[str, ...] = ()
    """Paragraphs, plain text."""
    fields: tuple[Field, ...] = ()
    buttons: tuple[Button, ...] = ()
    """On a teaching screen they stand in the menu at the top."""
    session: str | None = None
    code: str = ""
    """Shown large, to be copied: a completion code."""
    link: str = ""
    """An https address to go on to, with `link_label`."""
    link_label: str = ""


@dataclass(frozen=True, slots=True)
class Person:
    """Who sits at the page, as proved by their token."""

    pseudonym: str
    session: str
    """The session, or the study, that the token names."""
    token_id: str
    invitation: str = ""


class FlowRefusal(Exception):  # noqa: N818 - not a fault of the program
    """What the person did there is not possible; the text is one line for them."""


class Flow(Protocol):
    """Which screen a person sees. Called on the gateway's one loop: a sync of the disk is long."""

    def arrive(self, person: Person, arrival: Mapping[str, str]) -> None:
        """Note that a person has opened the page, for the first time or again.

        Args: arrival: the parameters of the address they came by (PROLIFIC_PID and the like), first value of
        each, untrusted. Raises: FlowRefusal when they may not take part.
        """

    def screen(self, person: Person) -> Screen:
        """Return what the person sees now.

        Asked again after every `submit` and arrival and about every second, so that time alone may change it:
        it answers from memory.
        """

    def submit(self, person: Person, screen: str, button: str, values: Mapping[str, Value]) -> None:
        """Take what a person did: a button of the screen of that name, or FINISHED from the gateway itself.

        The values have been checked against the screen's fields. A screen that is not the present one is
        never handed on. Raises: FlowRefusal.
        """

    def depart(self, person: Person) -> None:
        """Note that a person has been gone for some seconds: they may come again, or not."""


class TeachOnly:
    """The flow without a study: a person teaches the session that the token names, and nothing else."""

    def arrive(self, person: Person, arrival: Mapping[str, str]) -> None:
        """See Flow."""

    def screen(self, person: Person) -> Screen:
        """See Flow."""
        return Screen("teach", session=person.session)

    def submit(self, person: Person, screen: str, button: str, values: Mapping[str, Value]) -> None:
        """See Flow."""

    def depart(self, person: Person) -> None:
        """See Flow."""
