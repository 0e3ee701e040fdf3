"""The codebook beside the tables: for people as Markdown, for programs as JSON."""

import json
from collections.abc import Mapping, Sequence

from services.exports.table import Column, Table

MISSING = (
    "A missing value is an empty cell in CSV (an empty text is written as two quotes) and null in Parquet."
)


def codebook_json(about: str, tables: Sequence[Table], digests: Mapping[str, str]) -> bytes:
    """Return the codebook for programs.

    Args: about: what the tables come from, one line; digests: SHA-256 of each file by its name.
    """
    document = {
        "about": about,
        "missing": MISSING,
        "tables": [
            {
                "name": table.name,
                "title": table.title,
                "rows": table.n_rows,
                "columns": [_entry(column) for column in table.columns],
            }
            for table in tables
        ],
        "sha256": dict(digests),
    }
    return (json.dumps(document, ensure_ascii=False, indent=2) + "\n").encode()


def codebook_markdown(about: str, tables: Sequence[Table]) -> bytes:
    """Return the codebook for people."""
    parts = [f"# Codebook\n\n{about}\n\n{MISSING}\n", *map(_section, tables)]
    return "\n".join(parts).encode()


def _entry(column: Column) -> dict[str, str]:
    return {
        "name": column.name,
        "type": column.kind.value,
        "unit": column.unit,
        "description": column.description,
    }


def _section(table: Table) -> str:
    rows = [
        " | ".join(["", f"`{column.name}`", column.kind.value, column.unit or "-", _flat(column), ""]).strip()
        for column in table.columns
    ]
    head = f"## {table.name}\n\n{table.title} {table.n_rows} rows.\n\n"
    return head + "| column | type | unit | what it is |\n|---|---|---|---|\n" + "\n".join(rows) + "\n"


def _flat(column: Column) -> str:
    """Return the description as one cell of a Markdown table."""
    return column.description.replace("|", "\\|").replace("\n", " ")
