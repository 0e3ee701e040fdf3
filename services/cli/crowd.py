"""`sfid crowd`: what many people's labels come to."""

import csv
from enum import StrEnum
from itertools import islice
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any, NamedTuple

import typer

from services.cli.crowd_files import Rows, read_labels, read_truth
from services.cli.shared.failure import CommandError
from services.cli.shared.options import Json, print_json
from sfid_core.crowd.labels import LabelSet, label_set
from sfid_core.crowd.methods import NAMES, Aggregated, aggregate
from sfid_core.crowd.outcome import accuracy, decided
from sfid_core.learning.parameters import ParameterError

WORKERS_SHOWN = 5
LABELS_SHOWN = 10

crowd_app = typer.Typer(
    help="What many people's labels come to, and whom to believe.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


class Ties(StrEnum):
    """What is said where two labels are equally probable."""

    DRAW = "draw"
    """One of them, drawn by the seed and the task's name."""
    ABSTAIN = "abstain"


class Answers(NamedTuple):
    """How posteriors become labels."""

    names: LabelSet
    seed: int | None
    abstain_below: float

    def by_task(self, posterior: Any) -> dict[Any, Any]:  # noqa: ANN401 - (tasks, K) float64
        """Return the label of each task by its name, None for an abstention."""
        tasks, classes = self.names.task_names, self.names.class_names
        found = decided(posterior, tasks, self.seed, self.abstain_below)
        return {
            task: None if index is None else classes[index] for task, index in zip(tasks, found, strict=True)
        }


def add_to(app: typer.Typer) -> None:
    """Add the crowd commands."""
    app.add_typer(crowd_app, name="crowd")


@crowd_app.command("aggregate")
def aggregate_file(  # noqa: PLR0917 - one argument an option
    file: Annotated[Path, typer.Argument(help="CSV with the columns task, worker, label.")],
    method: Annotated[str, typer.Option(help=f"One of {', '.join(NAMES)}.")] = "dawid-skene",
    truth: Annotated[Path | None, typer.Option(help="CSV with the columns task, label.")] = None,
    out: Annotated[Path | None, typer.Option(help="Write the labels to this CSV: task, label.")] = None,
    ties: Annotated[Ties, typer.Option(help="Where two labels are equally probable.")] = Ties.DRAW,
    seed: Annotated[int, typer.Option(help="Seed of the draws between ties.")] = 0,
    abstain_below: Annotated[float, typer.Option(help="Say nothing below this probability.")] = 0.0,
    prior: Annotated[
        float | None,
        typer.Option(
            help="dawid-skene: labels a class the prior is worth (0.1; online 1); sparse sets want more."
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Make one label a task of many workers' labels, and say how reliable each worker is."""
    if not 0 <= abstain_below <= 1:
        raise ParameterError(f"abstain_below {abstain_below} is outside 0 to 1: 0 always says something")
    if method not in NAMES:  # before a large file is read
        raise ParameterError(f"crowd method {method!r} is unknown: choose one of {', '.join(NAMES)}")
    rows = read_labels(file)
    known = None if truth is None else read_truth(truth)
    began = perf_counter()
    labels = label_set(rows.tasks, rows.workers, rows.labels)
    found = aggregate(labels, method, prior)
    seconds = perf_counter() - began
    answers = Answers(labels, seed if ties is Ties.DRAW else None, abstain_below)
    document = _document(method, seconds, rows, found, answers, known)
    if out is not None:
        _write(out, document["labels"])
        document["labels"] = str(out)
    if json:
        print_json(document)
    else:
        _print_summary(document)


def _document(
    method: str, seconds: float, rows: Rows, found: Aggregated, answers: Answers, truth: dict[Any, Any] | None
) -> dict[str, Any]:
    said = answers.by_task(found.outcome.posterior)
    document: dict[str, Any] = {
        "method": method,
        "accuracy": None if truth is None else accuracy(said, truth),
        "seconds": seconds,
        "tasks": len(said),
        "given": len(rows.labels),
        "superseded": rows.superseded,
        "abstained": sum(label is None for label in said.values()),
    }
    if found.live is not None:
        document["accuracy_live"] = None if truth is None else accuracy(answers.by_task(found.live), truth)
    workers = zip(
        answers.names.worker_names,
        found.outcome.reliability.tolist(),
        found.outcome.standard_error.tolist(),
        strict=True,
    )
    document["workers"] = [
        {"worker": worker, "reliability": mean, "standard_error": error} for worker, mean, error in workers
    ]
    document["labels"] = said
    return document


def _write(path: Path, labels: dict[str, str | None]) -> None:
    """Write the labels; an abstention is an empty cell."""
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(("task", "label"))
            writer.writerows((task, "" if label is None else label) for task, label in labels.items())
    except OSError as error:
        message = f"{path}: {error.strerror or error}: name a file that can be written"
        raise CommandError(message) from None


def _print_summary(document: dict[str, Any]) -> None:
    print(
        f"{document['method']}: {document['tasks']} tasks, {len(document['workers'])} workers, "
        f"{document['given']} labels, {document['abstained']} abstentions, {document['seconds']:.3f} s"
    )
    for name, text in (("accuracy", "accuracy"), ("accuracy_live", "accuracy as concluded one by one")):
        if document.get(name) is not None:
            print(f"{text} {document[name]:.4f}")
    least = sorted(document["workers"], key=lambda row: row["reliability"])[:WORKERS_SHOWN]
    print("least reliable workers:")
    for row in least:
        print(f"  {row['worker']:<24} {row['reliability']:.3f} +- {row['standard_error']:.3f}")
    labels = document["labels"]
    if isinstance(labels, str):
        print(f"labels in {labels}")
        return
    print("labels:")
    for task, label in islice(labels.items(), LABELS_SHOWN):
        print(f"  {task:<24} {'(abstained)' if label is None else label}")
    if len(labels) > LABELS_SHOWN:
        print(f"  and {len(labels) - LABELS_SHOWN} more: --out FILE.csv writes all, --json prints them")
