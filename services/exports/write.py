"""Tables into a directory: CSV, Parquet, and the codebook beside them."""

from collections.abc import Sequence
from enum import Enum
from hashlib import sha256
from pathlib import Path

from services.exports.codebook import codebook_json, codebook_markdown
from services.exports.csv_file import csv_bytes
from services.exports.parquet_file import parquet_bytes
from services.exports.table import ExportError, Table


class Format(Enum):
    """A kind of file; the value is its ending."""

    CSV = "csv"
    PARQUET = "parquet"


_WRITERS = {Format.CSV: csv_bytes, Format.PARQUET: parquet_bytes}


def write_tables(
    directory: Path, about: str, tables: Sequence[Table], formats: Sequence[Format] = tuple(Format)
) -> tuple[Path, ...]:
    """Write every table in every format, then codebook.md and codebook.json, over files of these names.

    Args: directory: made where it is missing; about: one line for the codebook: what the tables come from.
    Returns: the files in the order of writing. No file is ever seen half written.
    Raises: ExportError; what was written before it stays.
    """
    contents = {f"{table.name}.{form.value}": _WRITERS[form](table) for table in tables for form in formats}
    digests = {name: sha256(content).hexdigest() for name, content in contents.items()}
    contents["codebook.md"] = codebook_markdown(about, tables)
    contents["codebook.json"] = codebook_json(about, tables, digests)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        return tuple(_put(directory / name, content) for name, content in contents.items())
    except OSError as error:
        reason = error.strerror or str(error)
        raise ExportError(
            f"cannot write into {directory}: {reason}; give a directory you may write to"
        ) from error


def write_text(path: Path, text: str) -> Path:
    """Write a text over a file of that name, never half, and return it. Raises: ExportError."""
    try:
        return _put(path, text.encode())
    except OSError as error:
        reason = error.strerror or str(error)
        raise ExportError(
            f"cannot write {path}: {reason}; give a file in a folder you may write to"
        ) from error


def _put(path: Path, content: bytes) -> Path:
    part = path.with_name(path.name + ".part")
    part.write_bytes(content)
    part.replace(path)
    return path
