"""Records: what a session is told, does and measures, one instance and more with every step."""

from dataclasses import dataclass
from typing import TypeVar, dataclass_transform

T = TypeVar("T")


@dataclass_transform(frozen_default=True)
def record(kind: type[T]) -> type[T]:
    """Return the class as a dataclass with slots that is frozen for the type checker, and at run time not.

    To hold a dataclass frozen at run time makes its instances three times as dear, a named tuple twice.
    """
    return dataclass(slots=True, unsafe_hash=True)(kind)
