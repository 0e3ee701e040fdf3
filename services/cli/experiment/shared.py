"""What the experiments on the command line share: their options, seeds, worlds, progress and printing."""

import json
import sys
import time
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer
from rich.console import Console

from services.cli.session import SEED_MAX
from services.cli.shared.failure import CommandError
from services.cli.shared.level_files import check_starts, find_level
from services.cli.shared.progress import progress
from services.cli.shared.warnings import warn
from services.experiments.runnable import Runnable
from sfid_core.experiments.claims import Claim
from sfid_core.experiments.condition import Condition, Results, results_sha256
from sfid_core.session.config import WorldSpec

if TYPE_CHECKING:
    from services.experiments.runner import RunnerConfig

Seeds = Annotated[int, typer.Option(help="Number of seeds; all conditions share them.")]
Workers = Annotated[int, typer.Option(help="Threads (or processes without numba); 0: one a core.")]
Out = Annotated[
    Path | None,
    typer.Option(help="Folder for tables, figures, the recording and finished chunks (an interrupted run "
                 "with the same folder goes on)."),
]  # fmt: skip
Plain = Annotated[bool, typer.Option("--no-compile", help="Run without the compiler; the results are equal.")]


def seed_range(first: int, count: int) -> list[int]:
    """Return the seeds first, first + 1, ...; raise with the mend when there are too few or too many."""
    if not 2 <= count <= 1_000_000:
        message = f"seeds {count} is outside 2 to 1,000,000: intervals need 2, and claims 10 and more"
        raise CommandError(message)
    if not 0 <= first <= SEED_MAX - count:
        message = f"seed {first} is outside 0 to 2^53-1 less the number of seeds: choose another"
        raise CommandError(message)
    return list(range(first, first + count))


def world_spec(level: str, starts: str) -> WorldSpec:
    """Return the world of an experiment: the level by name or file, our rewards.

    Raises: CommandError, LevelError, WorldError for a level that cannot be read or solved.
    """
    title, found = find_level(level)
    check_starts(level, found, starts, 0)
    return WorldSpec(found.to_xsb(), title, starts)


def named(text: str, what: str, known: Sequence[str]) -> tuple[str, ...]:
    """Return the names of a list by comma, each once; raise with the mend for one that is not known."""
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",")))
    for name in names:
        if name not in known:
            message = f"unknown {what} {name!r}: choose from {', '.join(known)}, several by comma"
            raise CommandError(message)
    return names


class Run(NamedTuple):
    """Finished conditions and how long they took."""

    results: list[Results]
    seconds: float
    sha256: str


def run_all(
    conditions: Sequence[Condition],
    seeds: Sequence[int],
    workers: int,
    out: Path | None,
    *,
    plain: bool,
    warned: bool = True,
) -> Run:
    """Run every condition over every seed, with progress; finished chunks are kept in `out`.

    Warnings on the sessions go to stderr first, each once, but for `warned` false.
    """
    from services.experiments.runner import run_conditions
    from services.runtime.sources import keep_machine_code

    config = runner_config(conditions, seeds, workers, out, fast=False if plain else None)
    if warned:
        warn(*(condition.config for condition in conditions))
    if keep_machine_code(Path.home() / ".cache" / "sfid") and not plain:
        print("compiling the methods, once for this version: up to a minute", file=sys.stderr, flush=True)
    began = time.perf_counter()
    with progress("seeds") as told:
        results = run_conditions(conditions, seeds, config, told)
    return Run(results, time.perf_counter() - began, results_sha256(results))


def runner_config(
    conditions: Sequence[Runnable], seeds: Sequence[int], workers: int, out: Path | None, *, fast: bool | None
) -> "RunnerConfig":
    """Return how to run, with the folder checked and claimed; raise with the mend where it cannot be so."""
    from services.experiments.runner import RunnerConfig

    if workers < 0:
        message = f"workers {workers} is negative: 0 takes one a core"
        raise CommandError(message)
    if out is None:
        return RunnerConfig(workers, fast)
    _check_folder(out)
    _claim_folder(out, conditions, seeds)
    return RunnerConfig(workers, fast, out / "chunks")


def _check_folder(folder: Path) -> None:
    """Raise with the mend where nothing can be written, or drawn, before a long run rather than after it."""
    from services.cli.experiment.files import check_figures

    check_figures()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = f"{folder}: {error.strerror or error}: name a folder that can be written"
        raise CommandError(message) from None


def _claim_folder(folder: Path, conditions: Sequence[Runnable], seeds: Sequence[int]) -> None:
    """Note which experiment a folder holds; raise with the mend where it holds another one."""
    told = "".join(condition.digest for condition in conditions)
    digest = sha256(f"{told} {list(seeds)}".encode()).hexdigest()
    what = f"{len(conditions)} conditions, seeds {seeds[0]} to {seeds[-1]}"
    note = folder / "experiment.json"
    if note.exists():
        held = json.loads(note.read_text(encoding="utf-8"))
        if held.get("sha256") != digest:
            message = f"{folder} holds another experiment ({held.get('what')}): name a new folder"
            raise CommandError(message)
    note.write_text(json.dumps({"what": what, "sha256": digest}) + "\n", encoding="utf-8")


def print_findings(console: Console, claims: Sequence[Claim], files: Sequence[Path]) -> None:
    """Print what was found, one line a claim, and what was written."""
    for claim in claims:
        console.print(claim.line(), highlight=False, soft_wrap=True)
    for path in files:
        console.print(f"wrote {path}", highlight=False, soft_wrap=True)
