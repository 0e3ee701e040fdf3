"""The examples of services/exports/README.md, run as they stand there."""

import csv
import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from services.exports.session_story import read_story
from services.exports.session_tables import session_tables
from services.exports.write import write_tables
from tests.services.learner.classroom import Classroom, Pupil, session

PAGE = (Path(__file__).parents[3] / "services" / "exports" / "README.md").read_text(encoding="utf-8")


def example(name: str) -> str:
    found = re.search(rf"<!-- {name} -->\n```\w+\n(.*?)```\n<!-- end -->", PAGE, re.DOTALL)
    assert found is not None, name
    return found[1]


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A lesson in which ann says UP and bob DOWN, five decisions long."""
    folder = tmp_path_factory.mktemp("reading")
    room = Classroom(folder / "data")
    room.create(session(teachers_min=2))
    ann, bob = Pupil(room, "ann"), Pupil(room, "bob")
    ann.join()
    bob.join()
    for _ in range(5):
        decision = room.decision
        room.pass_time(100)
        ann.label(decision, "UP")
        room.pass_time(200)
        bob.label(decision, "DOWN")
    room.pass_time(600)
    room.shard.close()
    write_tables(folder / "tables", "A lesson.", session_tables(read_story(folder / "data", "s1")))
    return folder / "tables"


def expected(tables: Path) -> dict[str, tuple[int, float, float]]:
    """(answers, mean latency, share agreed) by teacher, by hand."""
    with (tables / "steps.csv").open(encoding="utf-8") as file:
        done = {row["decision"]: row["action"] for row in csv.DictReader(file)}
    ups = sum(action == "UP" for action in done.values())
    downs = sum(action == "DOWN" for action in done.values())
    assert len(done) == 5
    return {"ann": (5, 100.0, ups / 5), "bob": (5, 300.0, downs / 5)}


def run(program: list[str], tables: Path) -> str:
    done = subprocess.run(program, cwd=tables, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_pyarrow_example_runs_as_it_stands_and_is_right(tables: Path) -> None:
    told = [line.split() for line in run([sys.executable, "-c", example("pyarrow")], tables).splitlines()]
    assert {name: (int(n), float(ms), float(share)) for name, n, ms, share in told} == {
        name: (n, ms, round(share, 3)) for name, (n, ms, share) in expected(tables).items()
    }


@pytest.mark.skipif(importlib.util.find_spec("pandas") is None, reason="pandas is not installed")
def test_the_pandas_example_runs_as_it_stands(tables: Path) -> None:
    told = run([sys.executable, "-c", example("pandas")], tables)
    for name, (answers, latency_ms, share) in expected(tables).items():
        row = next(line.split() for line in told.splitlines() if line.startswith(name))
        assert [float(cell) for cell in row[1:]] == pytest.approx([answers, latency_ms, share])


@pytest.mark.skipif(shutil.which("Rscript") is None, reason="R is not installed")
def test_the_r_example_runs_as_it_stands(tables: Path) -> None:
    told = run(["Rscript", "-e", example("r")], tables)
    assert all(name in told for name in ("ann", "bob"))


def test_the_examples_are_python_that_compiles_and_name_columns_that_exist(tables: Path) -> None:
    for name in ("pandas", "pyarrow"):
        compile(example(name), name, "exec")
    columns = {
        cell
        for path in tables.glob("*.csv")
        for cell in path.read_text(encoding="utf-8").partition("\n")[0].split(",")
    }
    made = {"done", "agreed", "action_done", "agreed_count", "agreed_mean", "latency_ms_mean"}
    for name in ("pandas", "r"):
        named = set(re.findall(r'"(\w+)"', example(name))) - {"at", "median", "mean", "size"}
        assert named - made <= columns | {"_done"}, name


def test_a_missing_value_is_an_empty_cell_and_truth_and_times_are_what_the_page_says(tables: Path) -> None:
    with (tables / "answers.csv").open(encoding="utf-8") as file:
        row = next(csv.DictReader(file))
    assert (row["reward"], row["response_ms"], row["applied"]) == ("", "", "true")
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z", row["at"])
    text = "".join(path.read_text(encoding="utf-8") for path in tables.glob("*.csv"))
    assert not re.search(r"(^|,)(NA|NaN|nan|None|null)(,|$)", text, re.MULTILINE)
