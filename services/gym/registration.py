"""Makes environments known to Gymnasium: this project's, and those of installed packages.

Gymnasium before 1.0 called whatever packages name under the entry point `gymnasium.envs`; from 1.0 on it
wants an import. `gymnasium.make("services.gym.registration:sfid/Sokoban-v0")` does that by itself.
"""

import logging
from functools import lru_cache
from importlib.metadata import entry_points

import gymnasium
from gymnasium.envs.registration import namespace

log = logging.getLogger("sfid.gym")

GROUP = "gymnasium.envs"
ROOT = "__root__"
"""Name of an entry point whose environments stand in no namespace, as those of MiniGrid do."""
NAMESPACE, SOKOBAN = "sfid", "Sokoban-v0"


def register_environments() -> None:
    """Register `sfid/Sokoban-v0`; again changes nothing."""
    if f"{NAMESPACE}/{SOKOBAN}" not in gymnasium.registry:
        with namespace(NAMESPACE):
            gymnasium.register(SOKOBAN, entry_point="services.gym.sokoban:SokobanEnvironment")


@lru_cache(1)
def register_installed() -> None:
    """Register the environments of every installed package that names them, once a process."""
    for point in entry_points(group=GROUP):
        try:
            if point.name == ROOT:
                point.load()()
            else:
                with namespace(point.name):
                    point.load()()
        except Exception as error:  # noqa: BLE001 - one package's fault is not the others'
            log.warning("environments of %s are not registered: %s", point.value, error)


register_environments()
