"""`sfid methods` and `sfid teachers`: what there is to choose from, with parameters, ranges and sources."""

import ast
import inspect
import textwrap
from itertools import pairwise
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from services.cli.shared.options import Json, print_json
from services.cli.shared.tables import print_whole
from sfid_core.learning.method import Method
from sfid_core.learning.methods import METHODS, method_named
from sfid_core.learning.parameters import Choice, Value, as_written, limits
from sfid_core.teaching.kernels import TeacherParameters
from sfid_core.teaching.personas import PERSONAS, persona_named

Name = Annotated[str | None, typer.Argument(help="One of them, with its parameters.")]


def add_to(app: typer.Typer) -> None:
    """Add the two commands."""
    app.command()(methods)
    app.command()(teachers)


def methods(name: Name = None, as_json: Json = False) -> None:
    """List the learning methods; with a NAME, its parameters, their ranges and sources."""
    if name is not None:
        _show_method(method_named(name), as_json=as_json)
        return
    if as_json:
        print_json([_method_document(method) for method in METHODS.values()])
        return
    table = _table("method", "asks", "what")
    for method in METHODS.values():
        table.add_row(method.name, asks(method), method.summary)
    print_whole(table)
    print("`sfid methods NAME` tells its parameters: default, range or choices, meaning and source")


def teachers(name: Name = None, as_json: Json = False) -> None:
    """List the simulated teachers; with a NAME, their faults and habits."""
    if name is not None:
        summary = PERSONAS[name].summary if name in PERSONAS else ""
        _show(name, summary, persona_named(name), "value", as_json=as_json)
        return
    if as_json:
        print_json([_persona_document(each) for each in PERSONAS])
        return
    table = _table("teacher", "who")
    for each, persona in PERSONAS.items():
        table.add_row(each, persona.summary)
    print_whole(table)
    print("`sfid teachers NAME` tells their faults and habits: value, range or choices, meaning and source")


def asks(method: Method) -> str:
    """Return what a method asks of teachers, before and after the action."""
    return " and ".join(kind.value for kind in method.asks) or "nothing"


def _show_method(method: Method, *, as_json: bool) -> None:
    if as_json:
        print_json(_method_document(method))
        return
    _show(
        method.name,
        f"{method.summary}\nsource: {method.source}",
        method.parameters(),
        "default",
        as_json=False,
    )


def _show(name: str, what: str, parameters: Any, said: str, *, as_json: bool) -> None:  # noqa: ANN401 - each has its own
    if as_json:
        print_json(_persona_document(name) | {"parameters": parameter_rows(parameters)})
        return
    console = Console()
    console.print(f"{name}: {what}", highlight=False)
    table = _table("parameter", said, "range or choices", "meaning")
    for row in parameter_rows(parameters):
        source = f" ({row['source']})" if row["source"] else ""
        table.add_row(str(row["name"]), str(row["value"]), str(row["range"]), f"{row['meaning']}{source}")
    print_whole(table, console)


def meanings(kind: type[Any]) -> dict[str, str]:
    """Return what each field of a class means: the string below it in the source."""
    (found,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    body = found.body if isinstance(found, ast.ClassDef) else []
    return {
        field.target.id: " ".join(text.value.value.split())
        for field, text in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }  # fmt: skip


def parameter_rows(parameters: Any) -> list[dict[str, Value]]:  # noqa: ANN401 - each method has its own
    """Return name, value, range (with unit), meaning and source of each parameter."""
    allowed, values = limits(type(parameters)), as_written(parameters)
    told = meanings(type(parameters))
    rows: list[dict[str, Value]] = []
    for name, limit in allowed.items():
        unit = "" if isinstance(limit, Choice) else limit.unit
        within = f"{limit} {unit}".strip()
        rows.append({
            "name": name, "value": values[name], "range": within, "meaning": told.get(name, ""),
            "source": limit.source,
        })  # fmt: skip
    return rows


def _method_document(method: Method) -> dict[str, Any]:
    return {
        "method": method.name,
        "asks": [kind.value for kind in method.asks],
        "summary": method.summary,
        "source": method.source,
        "parameters": parameter_rows(method.parameters()),
    }


def _persona_document(name: str) -> dict[str, Any]:
    faults = as_written(persona_named(name))
    own = as_written(TeacherParameters())
    changed = {key: value for key, value in faults.items() if value != own[key]}
    return {"teacher": name, "summary": PERSONAS[name].summary, "faults": changed}


def _table(*columns: str) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for column in columns:
        table.add_column(column, no_wrap=column in {"method", "teacher", "parameter"})
    return table
