"""`sfid backup`: a proven copy of a data directory, also while its services run."""

import time
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from services.cli.shared.failure import NOT_SO, CommandError
from services.cli.shared.options import Json, print_json
from services.operations.backup import BackupError
from services.operations.backup import backup as copy_directory
from services.runtime.clock import SystemClock


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(backup)


def backup(
    directory: Annotated[Path, typer.Argument(help="Data directory; its services may run.")],
    out: Annotated[Path, typer.Argument(help="Directory to make; nothing may be there.")],
    json: Json = False,
) -> None:
    """Copy journals and what belongs to them to OUT, prove the copy, and put it there at once.

    OUT is a data directory: to restore, stop the services and start them on it (or on a copy of it). Secrets
    are in it, and people who are forgotten later: forget them there too. Recordings and logs are not.
    """
    began = time.monotonic()
    try:
        done = copy_directory(directory, out, SystemClock())
    except BackupError as error:
        raise CommandError(str(error), NOT_SO) from None
    seconds = time.monotonic() - began
    if json:
        shards = [msgspec.to_builtins(shard) for shard in done.shards]
        print_json(
            {
                "out": str(out), "rows": done.rows, "labels": done.labels, "shards": shards,
                "files": len(done.files), "kept": done.kept, "seconds": seconds,
            }
        )  # fmt: skip
        return
    print(
        f"{out}: {done.rows} rows with {done.labels} answers in {len(done.shards)} shards, proven; "
        f"{len(done.files)} other files; {seconds:.1f} s"
    )
