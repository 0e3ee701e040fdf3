"""What the environment says of this machine and its network."""

import os
from pathlib import Path

INSECURE = "SFID_INSECURE_NETWORK"
"""Set to 1, it says that everybody on the way to the router is trusted."""


def network_is_trusted() -> bool:
    """Tell whether messages may leave this machine in clear text."""
    return os.environ.get(INSECURE) == "1"


def state_folder() -> Path:
    """Return where this person's programs keep what outlives them: XDG_STATE_HOME, or ~/.local/state."""
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "sfid"
