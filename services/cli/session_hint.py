"""What is said to a teacher whose session is not there: what sessions there are, and the mend."""

import socket
from collections.abc import Callable
from functools import partial
from pathlib import Path

from protocol.keys import Keys
from protocol.messages import SessionList
from services.cli.session_rows import lacking
from services.cli.shared.next_command import suggested
from services.cli.shared.recorded import NAMES_MAX
from services.cli.shared.waiting import connected_bus
from services.operator import Operator, OperatorError
from services.runtime.bus import BusError
from services.runtime.endpoint import split_endpoint
from services.runtime.secret import SecretError
from services.topology import CROWD, Role

CONNECT_MS = 2_000
_KNOCK_S = 1.0


def session_hint(session: str, connect: str, deployment: str, access: Path | None) -> str:
    """Ask the learner which sessions it has and return one line; takes some seconds where nobody answers.

    Who has no operator's login, as people at an edge, cannot ask: they are told who can.

    Args: deployment: the teacher's, which may be that of a crowd.
    """
    learner = deployment.removesuffix(CROWD)
    if not _answers(connect):
        return f"the router {connect} does not answer: waiting for it"
    try:
        bus = connected_bus(connect, Role.OPERATOR, access, CONNECT_MS)
        try:
            listed = Operator(bus, Keys(learner), patience_s=0.0).sessions()
        finally:
            bus.close()
    except SecretError:
        listing = suggested("session list", connect, learner)
        return f"waiting for it: who created it sees in {listing} whether it is there"
    except (BusError, OperatorError) as error:
        return f"what sessions there are could not be asked: {error}"
    at = partial(suggested, connect=connect, deployment=learner, access=access)
    return hint_of(session, listed, at, crowd=deployment.endswith(CROWD))


def _answers(connect: str) -> bool:
    _, host, port = split_endpoint(connect)
    try:
        socket.create_connection((host, port), _KNOCK_S).close()
    except OSError:
        return False
    return True


def hint_of(session: str, listed: SessionList, at: Callable[[str], str], *, crowd: bool) -> str:
    """Return the line for a learner, or the learners of some shards, that listed these sessions.

    Args: at: makes a command's words one that reaches this learner, ready to be pasted.
    """
    names = [row.session for row in listed.sessions]
    if session in names:
        whom = "the aggregator, which comes with --crowd of `sfid up`," if crowd else "the learner"
        return f"the session is there: see in {at('status')} whether {whom} is well"
    if (not_whole := lacking(listed, at("status"))) is not None:
        return not_whole
    create = at(f"session create {session}")
    if not names:
        return f"there is no session at all: {create} creates it"
    more = f" and {len(names) - NAMES_MAX} more" if len(names) > NAMES_MAX else ""
    latest = ", ".join(names[-NAMES_MAX:]) + more
    return f"there are {latest}: name one of them with --session, or {create} creates this one"
