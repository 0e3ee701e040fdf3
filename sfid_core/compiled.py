"""Kernels: plain scalar functions that run as they are, or compiled by numba when it is there.

A kernel is written once. The live learner calls it as Python with lists; a batch run calls the same source
compiled, with arrays. Both give the same bits, because a kernel uses float64 arithmetic in a stated order, no
reduction and no chance but `sfid_core.chance`.
"""

from collections.abc import Callable, Mapping
from dis import get_instructions
from functools import cache
from importlib.util import find_spec
from types import FunctionType
from typing import Any, TypeVar, cast

import numpy as np

from sfid_core import chance

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_KERNELS: set[Callable[..., Any]] = set()


def kernel(function: Kernel) -> Kernel:
    """Mark a function as a kernel: scalars, flat sequences and named tuples of them are all it may use."""
    _KERNELS.add(function)
    return function


def compiler_available() -> bool:
    """Tell whether numba is installed (the extra `fast`)."""
    return find_spec("numba") is not None


def linked(function: Kernel, parts: Mapping[str, Callable[..., Any]]) -> Kernel:
    """Return the function as Python with the named globals replaced by `parts`, in what it calls too."""
    return cast("Kernel", _linked(cast("FunctionType", function), dict(parts)))


def compiled(function: Kernel, parts: Mapping[str, Callable[..., Any]], name: str) -> Kernel:
    """Return the function compiled, the named globals replaced by `parts`, and every kernel it calls with it.

    Args: name: tells apart what one function becomes with different parts.
    The compiled function releases the interpreter's lock. Machine code is kept between processes where
    `numba.config.CACHE_DIR` is set; that directory must be named after the kernels' sources, because numba
    does not look at what a function calls.
    """
    return cast("Kernel", _compiled(cast("FunctionType", function), tuple(sorted(parts.items())), name))


def _linked(function: FunctionType, parts: dict[str, Callable[..., Any]]) -> FunctionType:
    replaced = dict(parts)
    for called in _globals_of(function):
        inner = function.__globals__.get(called)
        if called not in parts and inner in _KERNELS and _mentions(inner, parts):
            replaced[called] = _linked(inner, parts)
    return _rebuilt(function, replaced, "")


def _mentions(function: FunctionType, parts: Mapping[str, Callable[..., Any]]) -> bool:
    """Tell whether a kernel, or one that it calls, refers to a part by name."""
    for called in _globals_of(function):
        inner = function.__globals__.get(called)
        if called in parts or (inner in _KERNELS and _mentions(inner, parts)):
            return True
    return False


@cache
def _globals_of(function: FunctionType) -> tuple[str, ...]:
    """Return the names of globals that a function reads; an attribute of the same name is none."""
    loads = (one.argval for one in get_instructions(function) if one.opname == "LOAD_GLOBAL")
    return tuple(dict.fromkeys(loads))


@cache
def _compiled(
    function: FunctionType,
    parts: tuple[tuple[str, Callable[..., Any]], ...],
    name: str,
    *,
    inlined: bool = False,
) -> object:
    import numba  # noqa: PLC0415 - optional, and half a second to load

    replaced = dict(parts)
    for called in _globals_of(function):
        part = replaced.get(called, function.__globals__.get(called))
        native = _NATIVE.get(part, part) if isinstance(part, FunctionType) else part
        if isinstance(native, FunctionType) and (native in _KERNELS or native is not part):
            inner = parts if called not in dict(parts) and _mentions(native, dict(parts)) else ()
            replaced[called] = cast("Callable[..., Any]", _compiled(native, inner, name, inlined=True))
    keep = bool(getattr(numba.config, "CACHE_DIR", ""))
    # A call costs more than most kernels do: named tuples are taken apart and put together again. Joined as
    # source, not as machine code, kernels are optimised for the constants that they are called with. And they
    # make no arrays, so nothing has to count who refers to one: that alone is five sixths of a step.
    options: dict[str, Any] = {
        "nogil": True,
        "cache": keep,
        "inline": "always" if inlined else "never",
        "_nrt": False,
    }
    return numba.njit(**options)(_rebuilt(function, replaced, name))


def _rebuilt(function: FunctionType, parts: dict[str, Callable[..., Any]], name: str) -> FunctionType:
    code = function.__code__
    if name:
        label = f"{code.co_name}_{name}".replace("-", "_")
        code = code.replace(co_name=label, co_qualname=label)
    rebuilt = FunctionType(code, {**function.__globals__, **parts}, code.co_name, function.__defaults__)
    rebuilt.__module__ = function.__module__
    return rebuilt


# `sfid_core.chance` in machine words: Python's integers do not overflow, the compiler's must.


def _draw(key: Any, counter: Any) -> Any:  # noqa: ANN401 - machine words
    z = np.uint64(key) + (np.uint64(counter) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def _below(key: Any, counter: Any, n: Any) -> Any:  # noqa: ANN401 - as _draw
    return np.int64(((draw(key, counter) >> np.uint64(32)) * np.uint64(n)) >> np.uint64(32))


def _unit(key: Any, counter: Any) -> Any:  # noqa: ANN401 - as _draw
    return np.float64(draw(key, counter) >> np.uint64(11)) * 2.0**-53


draw = chance.draw
_NATIVE: dict[Callable[..., Any], FunctionType] = {
    chance.draw: cast("FunctionType", _draw),
    chance.below: cast("FunctionType", _below),
    chance.unit: cast("FunctionType", _unit),
}
