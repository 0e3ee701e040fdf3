"""Makes environments known to Gymnasium: this project's, and those of installed packages.

Gymnasium before 1.0 called whatever packages name under the entry point `gymnasium.envs`; from 1.0 on it
wants an import. `gymnasium.make("services.gym.registration:sfid/Sokoban-v0")` does that by itself.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import lru_cache
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec

import gymnasium
from gymnasium.envs.registration import namespace

log = logging.getLogger("sfid.gym")

GROUP = "gymnasium.envs"
ROOT = "__root__"
"""Name of an entry point whose environments stand in no namespace, as those of MiniGrid do."""
NAMESPACE, SOKOBAN = "sfid", "Sokoban-v0"

IMPORTED = ("minigrid",)
"""Packages that register their environments when they are imported, and name no entry point for it."""


def register_environments() -> None:
    """Register `sfid/Sokoban-v0`; again changes nothing."""
    if f"{NAMESPACE}/{SOKOBAN}" not in gymnasium.registry:
        with namespace(NAMESPACE):
            gymnasium.register(SOKOBAN, entry_point="services.gym.sokoban:SokobanEnvironment")


@lru_cache(1)
def register_installed() -> None:
    """Register the environments of every installed package that names them or is known, once a process."""
    for package in IMPORTED:
        if find_spec(package) is not None:
            with _told(package):
                import_module(package)
    for point in entry_points(group=GROUP):
        with _told(point.value), nullcontext() if point.name == ROOT else namespace(point.name):
            point.load()()


@contextmanager
def _told(what: str) -> Iterator[None]:
    """Let one package's fault be told, and not be the others'."""
    try:
        yield
    except Exception as error:  # noqa: BLE001 - other people's code may fail in any way
        log.warning("environments of %s are not registered: %s", what, error)


register_environments()
