"""Sessions and episodes as JSON documents and as tables for people."""

from collections.abc import Sequence
from typing import Any

import msgspec
from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from protocol.messages import Episode, LabelTotals, SessionReport

COLUMNS_MAX = 10_000


def print_whole(table: Table, console: Console | None = None) -> None:
    """Print a table without cutting any cell: where the terminal, or a pipe's 80 columns, are too few, wider.

    Text that may be wrapped is wrapped first.
    """
    console = console or Console()
    for column in table.columns:
        if column.no_wrap:  # rich would cut these first, and not count them whole in a table's least width
            column.min_width = max(cell_len(str(cell)) for cell in (column.header, *column.cells))
    own = console.width
    needed = Measurement.get(console, console.options.update_width(COLUMNS_MAX), table).minimum
    console.width = max(own, needed)
    console.print(table)
    console.width = own


def episode_rows(episodes: Sequence[Episode]) -> list[dict[str, Any]]:
    """Return the four measures of each episode, beside the optimal step count."""
    return [
        {
            "episode": episode.episode,
            "steps": episode.steps,
            "optimal_steps": episode.optimal_steps,
            "abs_td_error": episode.abs_td_error,
            "discounted_return": episode.discounted_return,
            "discounted_env_return": episode.discounted_env_return,
            "inputs": episode.inputs,
            "outcome": episode.outcome,
        }
        for episode in episodes
    ]


def report_document(report: SessionReport, episodes: Sequence[Episode]) -> dict[str, Any]:
    """Return a session with its measures as a JSON document."""
    return {
        "session": report.summary.session,
        "method": report.summary.method,
        "level": report.summary.level_name,
        "episodes": episode_rows(episodes),
        "labels": msgspec.to_builtins(report.labels),
        "teaching_seconds": report.teaching_ns / 1e9,
        "q_sha256": report.q_sha256,
    }


def print_episodes(console: Console, episodes: Sequence[Episode]) -> None:
    """Print the table of the four measures per episode."""
    table = Table(
        title="Episodes",
        box=SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
        caption="TD error: mean |delta| of Eq. 2\nreturn: sum of gamma^t (r + h); env: h = 0",
    )
    for name in ("episode", "outcome"):
        table.add_column(name, no_wrap=True)
    for name in ("steps", "optimal", "TD error", "return", "env return", "inputs"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in episode_rows(episodes):
        optimal = row["optimal_steps"]
        table.add_row(
            str(row["episode"]),
            row["outcome"],
            str(row["steps"]),
            "-" if optimal is None else str(optimal),
            f"{row['abs_td_error']:.3f}",
            f"{row['discounted_return']:.2f}",
            f"{row['discounted_env_return']:.2f}",
            str(row["inputs"]),
        )
    print_whole(table, console)


def labels_line(labels: LabelTotals) -> str:
    """Return what became of the answers, as one line."""
    counts = msgspec.to_builtins(labels)
    return "labels: " + ", ".join(f"{value} {name}" for name, value in counts.items())
