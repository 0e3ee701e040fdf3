"""`sfid replay` and `sfid verify`: what a journal tells, and whether it is whole."""

from pathlib import Path
from typing import Annotated

import typer

from protocol.codec import DecodeError
from services.cli.failure import NOT_SO, CommandError
from services.cli.options import Json, print_json
from services.replay import Replayed, ReplayedCrowd, replay_crowds, replay_directory
from services.runtime.journal import verify as verify_journal


def add_to(app: typer.Typer) -> None:
    """Add the journal commands."""
    app.command()(replay)
    app.command()(verify)


DirectoryArgument = Annotated[Path, typer.Argument(help="Data directory of a learner.")]


def replay(
    directory: DirectoryArgument,
    session: Annotated[str | None, typer.Option(help="Only this session.")] = None,
    verify: Annotated[
        bool,
        typer.Option("--verify", help="Exit 1 when a noted digest, or what a teacher was told, differs."),
    ] = False,
    json: Json = False,
) -> None:
    """Rebuild Q and crowds from their journals alone and compare them with what was noted."""
    try:
        replayed = replay_directory(directory, session)
        crowds = replay_crowds(directory, session)
    except DecodeError as error:
        message = f"{directory}: a row cannot be read ({error}): `sfid verify {directory}` tells where"
        raise CommandError(message, NOT_SO) from None
    if not replayed:
        what = "no session" if session is None else f"no session {session}"
        message = f"{directory}: {what} in this journal: name the --data directory of a learner"
        raise CommandError(message)
    if json:
        print_json(
            {"sessions": [_row(one) for one in replayed], "crowds": [_crowd_row(one) for one in crowds]}
        )
    else:
        for one in replayed:
            verdict = f"matches {one.digests} noted digests" if one.matches else "DIFFERS"
            counts = f"{one.events} events, {one.episodes} episodes"
            print(f"{one.session}: {counts}, q_sha256 {one.q_sha256}: {verdict}")
        for crowd in crowds:
            verdict = "matches what was handed on" if crowd.matches else "DIFFERS"
            counts = f"{crowd.conclusions} conclusions of {len(crowd.reliabilities)} workers"
            print(f"{crowd.session}, crowd {crowd.aggregator}: {counts}: {verdict}")
    if verify and not (all(one.matches for one in replayed) and all(one.matches for one in crowds)):
        raise typer.Exit(NOT_SO)


def _row(one: Replayed) -> dict[str, object]:
    return {"session": one.session, "q_sha256": one.q_sha256, "matches": one.matches, "events": one.events}


def _crowd_row(one: ReplayedCrowd) -> dict[str, object]:
    workers = [
        {"worker": worker, "reliability": known.mean, "standard_error": known.standard_error,
         "labels": known.labels, "standing": known.standing}
        for worker, known in one.reliabilities.items()
    ]  # fmt: skip
    return {
        "session": one.session, "aggregator": one.aggregator, "matches": one.matches,
        "conclusions": one.conclusions, "workers": workers,
    }  # fmt: skip


def verify(directory: DirectoryArgument, json: Json = False) -> None:
    """Check a journal: dense numbers, hash chain, mirror against database, unique answers."""
    found = verify_journal(directory)
    if json:
        print_json(
            {
                "ok": found.ok,
                "sessions": found.sessions,
                "labels": found.labels,
                "problems": list(found.problems),
            }
        )
    else:
        verdict = "ok" if found.ok else "NOT OK"
        print(f"{verdict}: {found.sessions} sessions, {found.labels} labels, {found.rows} rows")
        for problem in found.problems:
            print(f"  {problem}")
    if not found.ok:
        raise typer.Exit(NOT_SO)
