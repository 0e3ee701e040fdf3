"""What an experiment sets otherwise than by default, with the meaning of each parameter."""

from collections.abc import Iterator, Mapping, Sequence

from rich.console import Console

from services.cli.catalogue import parameter_rows
from sfid_core.learning.methods import method_named
from sfid_core.learning.parameters import Value
from sfid_core.teaching.kernels import TeacherParameters

Setting = dict[str, Value]
WHERE = "`sfid methods NAME` tells every parameter of a method, `sfid teachers NAME` those of a teacher"


def settings_of(
    row: str, method: str, parameters: Mapping[str, Value], habits: Mapping[str, Value] | None = None
) -> Iterator[Setting]:
    """Yield what a row of an experiment sets: of its method, then of its teachers."""
    for owner, numbers, given in (
        (method, method_named(method).parameters(), parameters),
        ("its teachers", TeacherParameters(), habits or {}),
    ):
        for known in parameter_rows(numbers):
            name = str(known["name"])
            if name in given:
                yield {
                    "row": row, "of": owner, "parameter": name, "value": given[name],
                    "default": known["value"], "range": known["range"], "meaning": known["meaning"],
                }  # fmt: skip


def print_settings(console: Console, settings: Sequence[Setting]) -> None:
    """Print what is set, a line each, and where everything else is told."""
    for one in settings:
        line = "{row}: {of} with {parameter} {value}, not {default}: {meaning}".format_map(one)
        console.print(line, highlight=False, soft_wrap=True, markup=False)
    console.print(WHERE, highlight=False, soft_wrap=True)
