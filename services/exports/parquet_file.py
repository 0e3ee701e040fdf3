"""Tables as Parquet; a column carries its unit and description with it."""

import importlib
from typing import Any

from services.exports.table import Column, ExportError, Kind, Table


def parquet_bytes(table: Table) -> bytes:
    """Return the table as one Parquet file, compressed with Zstandard.

    The same table gives the same bytes as long as pyarrow stays the same. Raises: ExportError.
    """
    arrow, parquet = _arrow("pyarrow"), _arrow("pyarrow.parquet")
    fields = [_field(arrow, column) for column in table.columns]
    schema = arrow.schema(fields, metadata={"title": table.title})
    arrays = [
        arrow.array(table.listed(column), type=field.type)
        for column, field in zip(table.columns, fields, strict=True)
    ]
    sink = arrow.BufferOutputStream()
    parquet.write_table(arrow.Table.from_arrays(arrays, schema=schema), sink, compression="zstd")
    content: bytes = sink.getvalue().to_pybytes()
    return content


def _arrow(module: str) -> Any:  # noqa: ANN401 - a module without types
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ExportError(
            "Parquet needs pyarrow, which is not installed: pip install pyarrow, or export CSV only"
        ) from error


def _field(arrow: Any, column: Column) -> Any:  # noqa: ANN401 - values of a module without types
    types = {
        Kind.TEXT: arrow.string(),
        Kind.WHOLE: arrow.int64(),
        Kind.NUMBER: arrow.float64(),
        Kind.TRUTH: arrow.bool_(),
    }
    metadata = {"description": column.description} | ({"unit": column.unit} if column.unit else {})
    return arrow.field(column.name, types[column.kind], metadata=metadata)
