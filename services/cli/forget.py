"""`sfid forget`: a person's bytes are erased, and Q is what others alone would have taught."""

from pathlib import Path
from typing import Annotated, Any

import typer

from services.cli.shared.failure import BAD_USAGE, NOT_SO, CommandError
from services.cli.shared.options import Json, print_json
from services.operations.forget import Forgetting
from services.operations.forget import forget as erase
from services.runtime.clock import SystemClock
from services.study.erasure import erasures
from sfid_core.study.errors import StudyError


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(forget)


def forget(
    directory: Annotated[Path, typer.Argument(help="Data directory of a deployment; its services stopped.")],
    person: Annotated[list[str] | None, typer.Option(help="Pseudonym; may be repeated.")] = None,
    session: Annotated[str | None, typer.Option(help="Only what they said in this session.")] = None,
    study: Annotated[
        bool, typer.Option("--study", help="Everybody who had their answers deleted in a study.")
    ] = False,
    recordings: Annotated[
        bool,
        typer.Option(
            "--recordings/--keep-recordings",
            help="Also remove recordings of their sessions and exports with them: both can be made again.",
        ),
    ] = True,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only tell what would be erased.")] = False,
    json: Json = False,
) -> None:
    """Erase a person from the journals of learner, crowds and studies, and rebuild Q without them."""
    people = list(dict.fromkeys([*(person or ()), *(_withdrawn(directory) if study else ())]))
    if not people and not study:
        message = "whom to forget: name --person PSEUDONYM, or --study for all who had their answers deleted"
        raise CommandError(message, BAD_USAGE)
    done = [
        erase(directory, one, SystemClock(), session, dry_run=dry_run, recordings=recordings)
        for one in people
    ]
    if json:
        print_json({"dry_run": dry_run, "people": [_row(one) for one in done]})
    else:
        for one in done:
            _tell(one, dry_run=dry_run)
    nobody = [one.person for one in done if not one.rows and not one.loose.rewritten]
    if nobody and not study:
        message = f"{directory}: nothing there speaks of {', '.join(nobody)}: `sfid said` names who answered"
        raise CommandError(message, NOT_SO)


def _withdrawn(directory: Path) -> list[str]:
    names = sorted(path.name.removeprefix("study-") for path in directory.glob("study-*"))
    try:
        return sorted({one.person for name in names for one in erasures(directory, name)})
    except StudyError as error:
        raise CommandError(str(error)) from None


def _tell(one: Forgetting, *, dry_run: bool) -> None:
    verb = "would erase" if dry_run else "erased"
    print(
        f"{one.person}: {verb} {one.answers} answers; {one.rows} rows in all, "
        f"{one.crowd_rows} of them in crowds, {one.study_rows} in studies"
    )
    if one.revoked:
        print("  their tokens are worth nothing from now on")
    for name, kept in one.sessions.items():
        print(f"  {name}: q_sha256 {kept.q_sha256_before} becomes {kept.q_sha256}")
    for path in one.loose.recordings:
        print(f"  {'removed' if one.loose.removed else 'still shows them, remove it'}: {path}")
    for path in one.loose.left:
        print(f"  still names them, look at it: {path}")


def _row(one: Forgetting) -> dict[str, Any]:
    return {
        "person": one.person,
        "answers": one.answers,
        "rows": one.rows,
        "crowd_rows": one.crowd_rows,
        "study_rows": one.study_rows,
        "sessions": [
            {
                "session": name, "answers": kept.answers, "corrected": kept.corrected,
                "followed": kept.followed, "q_sha256_before": kept.q_sha256_before, "q_sha256": kept.q_sha256,
            }
            for name, kept in one.sessions.items()
        ],
        "recordings": [str(path) for path in one.loose.recordings],
        "recordings_removed": one.loose.removed,
        "tokens_revoked": one.revoked,
        "rewritten": [str(path) for path in one.loose.rewritten],
        "left": [str(path) for path in one.loose.left],
    }  # fmt: skip
