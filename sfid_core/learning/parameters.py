"""Parameters of methods: named tuples of numbers with a range each, so that one form serves every use.

A kernel reads them by name, compiled or not; a configuration gives them by name, choices as words.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar, get_type_hints


class ParameterError(ValueError):
    """A parameter is outside its range; the text is one line with the name, the value and the mend."""


@dataclass(frozen=True, slots=True)
class Range:
    """The numbers a parameter may take, low to high: not low itself where `above`, not high where `below`."""

    low: float
    high: float
    above: bool = False
    below: bool = False
    unit: str = ""
    source: str = ""
    """Where the default comes from."""

    def __contains__(self, value: float) -> bool:
        low = self.low < value if self.above else self.low <= value
        return low and (value < self.high if self.below else value <= self.high)

    def __str__(self) -> str:
        return f"{'(' if self.above else '['}{self.low:g}, {self.high:g}{')' if self.below else ']'}"


@dataclass(frozen=True, slots=True)
class Choice:
    """The words a parameter may take; a kernel sees the word's place in the list."""

    words: tuple[str, ...]
    source: str = ""

    def __str__(self) -> str:
        return ", ".join(self.words)


ALPHA = Range(0, 1, above=True, source="Raza, Johnston & Williams 2016")
GAMMA = Range(0, 1, below=True, source="Raza, Johnston & Williams 2016")
RATE = Range(0, 1)

Numbers = TypeVar("Numbers", bound=NamedTuple)
Value = float | str
"""A parameter as people write it: a number, or the word of a choice."""


def limits(kind: type[Any]) -> dict[str, Range | Choice]:
    """Return the range of each parameter, in their order."""
    hints = get_type_hints(kind, include_extras=True)
    return {name: hints[name].__metadata__[0] for name in kind._fields}


def parameters_of(kind: type[Numbers], given: Mapping[str, Value], where: str) -> Numbers:
    """Return the parameters with the given ones in place of the defaults.

    Args: kind: a NamedTuple of Annotated fields; where: what they are parameters of, for the error.
    Raises: ParameterError for an unknown name or a value out of range.
    """
    allowed = limits(kind)
    numbers: dict[str, float] = {}
    for name, value in given.items():
        if name not in allowed:
            message = f"{where} has no parameter {name!r}: it has {', '.join(allowed)}"
            raise ParameterError(message)
        numbers[name] = _number(name, value, allowed[name], kind._field_defaults[name])
    make: Callable[..., Numbers] = kind
    return make(**numbers)


def as_written(parameters: tuple[float, ...]) -> dict[str, Value]:
    """Return every parameter by name as people write it: numbers, and the words of choices."""
    allowed = limits(type(parameters))
    return {
        name: one.words[int(number)] if isinstance(one := allowed[name], Choice) else number
        for name, number in zip(allowed, parameters, strict=True)
    }


def _number(name: str, value: Value, allowed: Range | Choice, default: float) -> float:
    if isinstance(allowed, Choice):
        if value not in allowed.words:
            message = f"{name} {value!r} is unknown: choose one of {allowed}"
            raise ParameterError(message)
        return allowed.words.index(str(value))
    kept = f" ({allowed.source})" if allowed.source else ""
    if isinstance(value, str):
        message = f"{name} {value!r} is no number: give one in {allowed}; the default is {default:g}{kept}"
        raise ParameterError(message)
    if value not in allowed:
        message = f"{name} {value} is outside {allowed}: the default is {default:g}{kept}"
        raise ParameterError(message)
    return float(value)
