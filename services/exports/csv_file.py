"""Tables as CSV (RFC 4180, but lines end with a line feed): the same table gives the same bytes."""

from services.exports.table import Column, Kind, Table


def csv_bytes(table: Table) -> bytes:
    """Return the table in UTF-8, a header first; a missing cell is empty.

    Numbers are the shortest decimals that read back to the same float64, truth is `true` or `false`, an
    empty text is two quotes. Raises: ExportError.
    """
    header = ",".join(_text(column.name) for column in table.columns)
    columns = [_cells(table, column) for column in table.columns]
    lines = [header, *map(",".join, zip(*columns, strict=True))]
    return ("\n".join(lines) + "\n").encode()


def _cells(table: Table, column: Column) -> list[str]:
    values = table.listed(column)
    if column.kind is Kind.TEXT:
        written = {value: _text(value) for value in set(values) if value is not None}
        return ["" if value is None else written[value] for value in values]
    if column.kind is Kind.TRUTH:
        return ["" if value is None else ("false", "true")[value] for value in values]
    return ["" if value is None else repr(value) for value in values]


def _text(text: str) -> str:
    """Return the text as a cell, quoted where it needs to be; empty ones are, as they are not missing."""
    if text and text.strip() == text and not any(sign in text for sign in ',"\n\r'):
        return text
    return '"' + text.replace('"', '""') + '"'
