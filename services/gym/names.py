"""Names of an environment's actions: those of the screen where they move something, its own elsewhere."""

ACTIONS: dict[str, tuple[str, ...]] = {
    "FrozenLake": ("LEFT", "DOWN", "RIGHT", "UP"),
    "FrozenLake8x8": ("LEFT", "DOWN", "RIGHT", "UP"),
    "CliffWalking": ("UP", "RIGHT", "DOWN", "LEFT"),
    "CliffWalkingSlippery": ("UP", "RIGHT", "DOWN", "LEFT"),
    "Taxi": ("DOWN", "UP", "RIGHT", "LEFT", "PICKUP", "DROPOFF"),
    "Blackjack": ("STICK", "HIT"),
    "MiniGrid": ("LEFT", "RIGHT", "FORWARD", "PICKUP", "DROP", "TOGGLE", "DONE"),
    "BabyAI": ("LEFT", "RIGHT", "FORWARD", "PICKUP", "DROP", "TOGGLE", "DONE"),
    "Sokoban": ("LEFT", "RIGHT", "UP", "DOWN"),
}
"""By the id without its namespace and version, or by the part of that before its first hyphen."""


def action_names(environment: str, count: int) -> tuple[str, ...]:
    """Return the names of `count` (1 or more) actions by index; ACTION_0 and so on where nobody knows."""
    own = environment.rpartition("/")[2]
    for name in (own.rpartition("-v")[0] or own, own.partition("-")[0]):
        known = ACTIONS.get(name)
        if known is not None and len(known) == count:
            return known
    return tuple(f"ACTION_{index}" for index in range(count))
