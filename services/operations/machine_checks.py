"""What a doctor looks at on the machine: Python, packages, limits, clock."""

import re
import resource
import sqlite3
import sys
import time
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, metadata, requires, version

from services.operations.checks import Check, fail, ok, warn

PYTHON_MIN = (3, 11)
SQLITE_MIN = (3, 37)
"""The first with STRICT tables."""
OPEN_FILES_MIN = 4_096
"""A router holds a socket for each client."""
YEAR_2025_NS = 1_735_689_600 * 1_000_000_000
CLOCK_SPAN_S = 0.05
CLOCK_DRIFT_MAX = 0.05
_NAME = re.compile(r"[A-Za-z0-9._-]+")
_LIMIT = re.compile(r"(==|>=|<)\s*([0-9.]+)")


def machine_checks() -> Iterator[Check]:
    """Yield every check of the machine."""
    yield _python()
    yield from packages()
    yield from _extras()
    yield _sqlite()
    yield _open_files()
    yield _clock()


def _python() -> Check:
    text = f"{sys.version.split()[0]} at {sys.executable}"
    if sys.version_info[:2] < PYTHON_MIN:
        return fail("python", text, "install Python 3.11 or newer and make the environment anew")
    return ok("python", text)


def packages(distribution: str = "sfid") -> Iterator[Check]:
    """Yield a check of each package that a distribution needs always."""
    try:
        wanted = requires(distribution) or []
    except PackageNotFoundError:
        yield fail("packages", f"{distribution} itself is not installed", "pip install -e '.[all]'")
        return
    faults = [fault for line in wanted if "extra ==" not in line for fault in misfits(line)]
    if faults:
        yield fail("packages", "; ".join(faults), "pip install -e . (or -r the lock file)")
    else:
        yield ok("packages", f"{sum('extra ==' not in line for line in wanted)} of the right versions")


def misfits(requirement: str) -> list[str]:
    """Return what is wrong with an installed package; nothing when it is there and fits."""
    requirement = requirement.partition(";")[0]
    found = _NAME.match(requirement)
    name = found[0] if found else requirement
    try:
        here = version(name)
    except PackageNotFoundError:
        return [f"{name} is not installed"]
    limits = _LIMIT.findall(requirement)
    fits = all(_fits(_numbers(here), sign, _numbers(limit)) for sign, limit in limits)
    return [] if fits else [f"{name} {here} is installed, {requirement.strip()} is wanted"]


def _fits(here: tuple[int, ...], sign: str, limit: tuple[int, ...]) -> bool:
    length = max(len(here), len(limit))
    ours, wanted = (each + (0,) * (length - len(each)) for each in (here, limit))
    return {"==": ours == wanted, ">=": ours >= wanted, "<": ours < wanted}[sign]


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"[0-9]+", text)[:4])


def _extras() -> Iterator[Check]:
    try:
        extras = metadata("sfid").get_all("Provides-Extra") or []
        wanted = requires("sfid") or []
    except PackageNotFoundError:
        return
    for extra in sorted(set(extras) - {"all", "test"}):
        lines = [line for line in wanted if re.search(rf"extra == ['\"]{extra}['\"]", line)]
        absent = [fault for line in lines for fault in misfits(line)]
        text = (
            f"not there ({'; '.join(absent)}): pip install -e '.[{extra}]' if you want it"
            if absent
            else "there"
        )
        yield ok(f"extra {extra}", text)


def _sqlite() -> Check:
    if sqlite3.sqlite_version_info[:2] < SQLITE_MIN:
        return fail("sqlite", sqlite3.sqlite_version, "install a Python built with SQLite 3.37 or newer")
    return ok("sqlite", sqlite3.sqlite_version)


def _open_files() -> Check:
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    text = f"a process may open {soft} files"
    if soft != resource.RLIM_INFINITY and soft < OPEN_FILES_MIN:
        return warn("open files", text, f"`ulimit -n {OPEN_FILES_MIN}` before the router, for many teachers")
    return ok("open files", text)


def _clock() -> Check:
    wall_ns, steady_ns = time.time_ns(), time.monotonic_ns()
    if wall_ns < YEAR_2025_NS:
        return fail("clock", "it says a time before 2025: tokens would not expire", "set the system's clock")
    time.sleep(CLOCK_SPAN_S)
    went = (time.time_ns() - wall_ns) / max(1, time.monotonic_ns() - steady_ns)
    if abs(went - 1) > CLOCK_DRIFT_MAX:
        text = f"it went {went:.2f} s in a second just now"
        return warn(
            "clock", text, "look whether something sets the time; windows are measured on another clock"
        )
    return ok("clock", time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()))
