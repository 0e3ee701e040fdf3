"""`sfid simulate`: the whole system under seeded faults, judged by the rules of ARCHITECTURE.md."""

import os
import signal
import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer

from services.cli.shared.failure import NOT_SO
from services.cli.shared.options import Json, print_json

if TYPE_CHECKING:
    from collections.abc import Iterator

    from services.simulate.campaign import Campaign, Judged

SEEDS = 100
FAILURES_SHOWN = 50


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(simulate)


def simulate(
    seeds: Annotated[
        int | None, typer.Option(min=1, max=10_000_000, help="Number of seeds: 100, or 1 with --seed.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, max=2**53, help="The first seed.")] = None,
    decisions: Annotated[
        int,
        typer.Option(
            min=0, max=100_000, help="Teach about so many decisions a seed; 0: a short lesson of 15 to 50."
        ),
    ] = 0,
    jobs: Annotated[
        int, typer.Option(min=0, max=256, help="Processes that share the seeds; 0: one a processor.")
    ] = 0,
    trace: Annotated[
        bool, typer.Option("--trace", help="Print everything that happened, on stderr.")
    ] = False,
    json: Json = False,
) -> None:
    """Run sessions in virtual time under drawn faults and check every rule; exit 1 when one does not hold.

    Messages are lost, delayed, doubled and reordered, links are cut, processes are killed and stopped, disks
    fill up and lose power. A seed decides all of it: the same seed is the same run to the byte.
    """
    from services.simulate.campaign import Campaign, campaign, judge

    count = seeds or (SEEDS if seed is None else 1)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: its processes end with it
    if trace:
        done = Campaign()
        for number in range(seed or 0, (seed or 0) + count):
            judged = judge(number, decisions, trace=True)
            _print_trace(judged)
            done.add(judged)
    else:
        done = _watched(campaign(seed or 0, count, jobs or os.cpu_count() or 1, decisions), count)
    if json:
        print_json(_document(done))
    else:
        _print_verdict(done)
    if done.failures:
        raise typer.Exit(NOT_SO)


def _watched(running: "Iterator[tuple[Campaign, Judged]]", count: int) -> "Campaign":
    """Run to the end with a progress bar on a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from services.simulate.campaign import Campaign

    done = Campaign()
    columns = (TextColumn("seeds"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, disable=not sys.stderr.isatty(), transient=True) as progress:
        task = progress.add_task("seeds", total=count)
        for done, _ in running:
            progress.update(task, completed=done.seeds)
    return done


def _document(done: "Campaign") -> dict[str, Any]:
    return {
        "seeds": done.seeds,
        "ok": not done.failures,
        "failures": [
            {"seed": one.seed, "rule": one.rule, "what": one.what, "repeat": one.repeat}
            for one in done.failures
        ],
        "steps": done.steps,
        "events": done.events,
        "faults": done.faults,
        "seconds": round(done.seconds, 3),
        "trace_sha256": done.trace_sha256,
    }


def _print_verdict(done: "Campaign") -> None:
    for one in done.failures[:FAILURES_SHOWN]:
        print(f"seed {one.seed}: {one.rule}: {one.what}; repeat: {one.repeat}")
    if len(done.failures) > FAILURES_SHOWN:
        print(f"... and {len(done.failures) - FAILURES_SHOWN} more")
    verdict = f"{len(done.failures)} FAILURES" if done.failures else "ok"
    pace = f" in {done.seconds:.1f} s" if done.seconds else ""
    print(
        f"{verdict}: {done.seeds} seeds, {done.steps} steps, {done.faults} faults, {done.events} events{pace}"
    )


def _print_trace(judged: "Judged") -> None:
    from services.simulate.trace import line

    for seen in judged.seen:
        print(line(seen), file=sys.stderr)
