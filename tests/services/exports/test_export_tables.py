"""Tables become files whose bytes say the same each time, and a codebook that leaves nothing unexplained."""

import csv
import io
import json
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest

from services.exports.csv_file import csv_bytes
from services.exports.parquet_file import parquet_bytes
from services.exports.table import Column, ExportError, Kind, Table
from services.exports.write import Format, write_tables

COLUMNS = (
    Column("who", Kind.TEXT, "Name | of the teacher."),
    Column("count", Kind.WHOLE, "Answers given.", "answers"),
    Column("time_s", Kind.NUMBER, "Time it took.", "s"),
    Column("agreed", Kind.TRUTH, "Whether they agreed."),
)
MIXED = Table(
    "mixed",
    "Each row is a teacher.",
    COLUMNS,
    {
        "who": ["ann", 'a "b", c', "", None, "two\nlines"],
        "count": [1, 2.0, np.int64(3), None, float("nan")],
        "time_s": np.array([0.1, 1e-300, np.nan, 1 / 3, -0.0]),
        "agreed": [True, 0, 1.0, None, np.int8(0)],
    },
)


def test_csv_has_these_bytes() -> None:
    assert csv_bytes(MIXED).decode() == (
        "who,count,time_s,agreed\n"
        "ann,1,0.1,true\n"
        '"a ""b"", c",2,1e-300,false\n'
        '"",3,,true\n'
        ",,0.3333333333333333,\n"
        '"two\nlines",,-0.0,false\n'
    )


def test_csv_reads_back_with_the_standard_reader() -> None:
    rows = list(csv.reader(io.StringIO(csv_bytes(MIXED).decode(), newline="")))
    assert rows[0] == ["who", "count", "time_s", "agreed"]
    assert [row[0] for row in rows[1:]] == ["ann", 'a "b", c', "", "", "two\nlines"]
    assert float(rows[4][2]) == 1 / 3


def test_parquet_reads_back_with_types_units_and_missing_cells() -> None:
    table = pyarrow.parquet.read_table(io.BytesIO(parquet_bytes(MIXED)))
    assert table.to_pydict() == {
        "who": ["ann", 'a "b", c', "", None, "two\nlines"],
        "count": [1, 2, 3, None, None],
        "time_s": [0.1, 1e-300, None, 1 / 3, -0.0],
        "agreed": [True, False, True, None, False],
    }
    assert [str(field.type) for field in table.schema] == ["string", "int64", "double", "bool"]
    assert table.schema.field("time_s").metadata == {b"description": b"Time it took.", b"unit": b"s"}
    assert table.schema.field("who").metadata == {b"description": b"Name | of the teacher."}
    assert table.schema.metadata == {b"title": b"Each row is a teacher."}


def test_the_same_table_gives_the_same_bytes_whether_listed_or_in_arrays() -> None:
    columns = COLUMNS[1:]
    listed = Table("t", "t", columns, {"count": [1, 2], "time_s": [0.5, 1.0], "agreed": [True, False]})
    arrays = Table(
        "t",
        "t",
        columns,
        {"count": np.array([1.0, 2.0]), "time_s": np.array([0.5, 1.0]), "agreed": np.array([1.0, 0.0])},
    )
    assert csv_bytes(listed) == csv_bytes(arrays) == b"count,time_s,agreed\n1,0.5,true\n2,1.0,false\n"
    assert parquet_bytes(listed) == parquet_bytes(arrays)


def test_what_is_not_a_number_is_a_missing_cell_in_arrays_of_every_kind() -> None:
    half_known = np.array([1.0, np.nan])
    table = Table("t", "t", COLUMNS[1:], {column.name: half_known for column in COLUMNS[1:]})
    assert csv_bytes(table) == b"count,time_s,agreed\n1,1.0,true\n,,\n"


def test_a_table_without_rows_keeps_its_header() -> None:
    empty = Table("t", "t", COLUMNS[:1], {"who": []})
    assert (csv_bytes(empty), empty.n_rows) == (b"who\n", 0)
    assert pyarrow.parquet.read_table(io.BytesIO(parquet_bytes(empty))).to_pydict() == {"who": []}


@pytest.mark.parametrize(
    "column, cells",
    [
        (COLUMNS[0], [3]),
        (COLUMNS[0], np.array([1.5])),
        (COLUMNS[1], [1.5]),
        (COLUMNS[1], np.array([1.5])),
        (COLUMNS[1], [float("inf")]),
        (COLUMNS[1], ["1"]),
        (COLUMNS[2], ["0.5"]),
        (COLUMNS[3], [2]),
        (COLUMNS[3], np.array([0.5])),
    ],
)
def test_a_cell_of_another_kind_is_refused_in_one_line(column: Column, cells: list[object]) -> None:
    table = Table("t", "t", (column,), {column.name: cells})
    with pytest.raises(ExportError, match=f"^table t, column {column.name}: .*; give each cell as a .*$"):
        csv_bytes(table)


def test_columns_that_do_not_fit_their_cells_are_refused_in_one_line() -> None:
    with pytest.raises(ExportError, match=r"table t explains \['who'\] and holds \['when'\]"):
        Table("t", "t", COLUMNS[:1], {"when": []})
    with pytest.raises(ExportError, match="columns of different lengths"):
        Table("t", "t", COLUMNS[:2], {"who": ["a"], "count": []})


def test_a_directory_gets_every_table_in_every_format_and_the_codebook(tmp_path: Path) -> None:
    directory = tmp_path / "new" / "tables"
    written = write_tables(directory, "Made for a test.", [MIXED])
    assert [path.name for path in written] == [
        "mixed.csv",
        "mixed.parquet",
        "codebook.md",
        "codebook.json",
    ]
    assert sorted(path.name for path in directory.iterdir()) == sorted(path.name for path in written)
    assert (directory / "mixed.csv").read_bytes() == csv_bytes(MIXED)
    codebook = json.loads((directory / "codebook.json").read_text(encoding="utf-8"))
    assert codebook["about"] == "Made for a test."
    assert codebook["tables"] == [
        {
            "name": "mixed",
            "title": "Each row is a teacher.",
            "rows": 5,
            "columns": [
                {"name": "who", "type": "text", "unit": "", "description": "Name | of the teacher."},
                {"name": "count", "type": "whole number", "unit": "answers", "description": "Answers given."},
                {"name": "time_s", "type": "number", "unit": "s", "description": "Time it took."},
                {
                    "name": "agreed",
                    "type": "true or false",
                    "unit": "",
                    "description": "Whether they agreed.",
                },
            ],
        }
    ]
    assert codebook["sha256"] == {
        name: sha256((directory / name).read_bytes()).hexdigest() for name in ("mixed.csv", "mixed.parquet")
    }
    people = (directory / "codebook.md").read_text(encoding="utf-8")
    assert "| `who` | text | - | Name \\| of the teacher. |\n" in people
    assert "| `time_s` | number | s | Time it took. |\n" in people


def test_csv_alone_can_be_asked_for(tmp_path: Path) -> None:
    written = write_tables(tmp_path, "about", [MIXED], [Format.CSV])
    assert [path.name for path in written] == ["mixed.csv", "codebook.md", "codebook.json"]


def test_a_place_that_cannot_be_written_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(
        ExportError, match=r"^cannot write into .*file: .*; give a directory you may write to$"
    ):
        write_tables(tmp_path / "file", "about", [MIXED])


def test_without_pyarrow_parquet_says_what_to_install_and_csv_still_works() -> None:
    script = (
        "import sys\n"
        "sys.modules['pyarrow'] = None\n"
        "from services.exports.write import Format, write_tables\n"
        "from services.exports.table import Column, ExportError, Kind, Table\n"
        "from services.exports.csv_file import csv_bytes\n"
        "from services.exports.parquet_file import parquet_bytes\n"
        "table = Table('t', 't', (Column('a', Kind.WHOLE, 'A.'),), {'a': [1]})\n"
        "print(csv_bytes(table))\n"
        "try:\n"
        "    parquet_bytes(table)\n"
        "except ExportError as error:\n"
        "    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        "b'a\\n1\\n'",
        "Parquet needs pyarrow, which is not installed: pip install pyarrow, or export CSV only",
    ]
