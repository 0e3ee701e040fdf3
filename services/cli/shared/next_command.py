"""The commands that a command suggests, with the flags that this deployment needs."""

import shlex
from pathlib import Path

from services.cli.shared.options import DATA, ENDPOINT
from services.runtime.endpoint import reached_at
from services.topology import CROWD

DEPLOYMENT = "local"
SESSION = "{session}"


def suggested(
    words: str,
    connect: str = ENDPOINT,
    deployment: str = DEPLOYMENT,
    access: Path | None = None,
    *,
    data: Path = DATA,
    usual_data: Path = DATA,
) -> str:
    """Return a command in backticks that can be pasted: with every flag that is not at its default.

    Args: words: the command without `sfid`; connect: endpoint at which the router listens or is reached;
    usual_data: the data directory that the command takes without --data.
    """
    flags: list[str] = []
    if reached_at(connect) != ENDPOINT:
        flags += ["--connect", reached_at(connect)]
    if deployment != DEPLOYMENT:
        flags += ["--deployment", deployment]
    if access is not None:
        flags += ["--access", str(access)]
    if data != usual_data:
        flags += ["--data", str(data)]
    return f"`{' '.join(['sfid', words, *map(shlex.quote, flags)])}`"


def teaching(connect: str, deployment: str, *, crowd: bool) -> str:
    """Return how a session of this deployment is taught, with `{session}` where its name goes.

    Args: crowd: whether a crowd teaches there too, as one of the teachers.
    """
    words = f"teach keyboard --session {SESSION}"
    alone = suggested(words, connect, deployment)
    member = suggested(words, connect, f"{deployment}{CROWD}")
    return f"{alone}, or as one of the crowd: {member}" if crowd else alone
