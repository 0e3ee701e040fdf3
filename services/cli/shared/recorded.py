"""The sessions that a data directory's journal holds, and what is said where a command needs another."""

from pathlib import Path

from protocol.journal import Kind
from services.cli.shared.failure import BAD_USAGE, CommandError
from services.runtime.journal import read_rows

NAMES_MAX = 10
"""Names that a line lists; a class's journal has hundreds."""


def session_names(directory: Path) -> list[str]:
    """Return the names of the sessions in a journal, sorted. Raises: JournalError."""
    return sorted({row.session for row in read_rows(directory) if row.kind == Kind.CREATED.value})


def no_such_session(directory: Path, session: str | None, exit_code: int = BAD_USAGE) -> CommandError:
    """Return what to say where a journal has no such session, or (None) not one alone: the names it has.

    Raises: JournalError.
    """
    names = session_names(directory)
    if not names:
        said = f"{directory}: no session in this journal: name the --data directory of a learner"
        return CommandError(said, exit_code)
    listed = ", ".join(names[:NAMES_MAX]) + (f" and {len(names) - NAMES_MAX} more" * (len(names) > NAMES_MAX))
    what = f"holds {len(names)} sessions" if session is None else f"no session {session}"
    return CommandError(f"{directory}: {what}: choose one with --session: {listed}", exit_code)
