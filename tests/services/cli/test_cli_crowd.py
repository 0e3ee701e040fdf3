"""`sfid crowd aggregate`: files of labels in, one label a task and each worker's reliability out."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from services.cli.crowd_files import Rows, read_labels, read_truth
from services.cli.shared.failure import CommandError
from sfid_core.crowd.methods import NAMES
from tests.core.crowd.crowds import DATA
from tests.services.cli.command_line import sfid

HEADER = "task,worker,label\n"
YES, NO = "gut, ja", "né"
RIGHT = {f"t{task}": (YES, NO)[task % 2] for task in range(30)}


def written(path: Path, header: str, rows: Sequence[tuple[str, ...]]) -> Path:
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([header.strip().split(","), *rows])
    return path


def aggregate(path: Path, *arguments: str) -> dict[str, Any]:
    """Return the JSON document of one run."""
    done = sfid("crowd", "aggregate", str(path), "--json", *arguments)
    assert (done.code, done.stderr) == (0, ""), done
    document: dict[str, Any] = json.loads(done.stdout)
    return document


@pytest.fixture
def labels(tmp_path: Path) -> Path:
    """Thirty tasks labelled rightly by ann and bob, and by cid the other way round."""
    rows = [
        (task, worker, right if worker != "cid" else {YES: NO, NO: YES}[right])
        for task, right in RIGHT.items()
        for worker in ("ann", "bob", "cid")
    ]
    return written(tmp_path / "labels.csv", HEADER, rows)


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    return written(tmp_path / "truth.csv", "task,label", list(RIGHT.items()))


@pytest.mark.real
@pytest.mark.parametrize("method", NAMES)
def test_every_method_answers_every_task_and_rates_every_worker(
    labels: Path, truth: Path, method: str
) -> None:
    document = aggregate(labels, "--method", method, "--truth", str(truth))
    assert document["method"] == method
    assert document["accuracy"] == 1.0
    assert document.get("accuracy_live") == (1.0 if method.startswith("online-") else None)
    assert 0 < document["seconds"] < 10
    assert (document["tasks"], document["given"], document["superseded"], document["abstained"]) == (
        30,
        90,
        0,
        0,
    )
    assert document["labels"] == RIGHT
    assert [row["worker"] for row in document["workers"]] == ["ann", "bob", "cid"]
    reliability = {row["worker"]: row["reliability"] for row in document["workers"]}
    assert reliability["ann"] == reliability["bob"] > 0.8
    assert reliability["cid"] < 0.2
    assert all(0 < row["standard_error"] < 0.1 for row in document["workers"])


@pytest.mark.real
def test_labels_go_to_a_file_and_ties_and_doubt_are_empty_cells(tmp_path: Path) -> None:
    path, out = tmp_path / "labels.csv", tmp_path / "out.csv"
    path.write_text(HEADER + "b,ann,x\nb,bob,y\na,ann,y\na,bob,y\na,cid,x\nc,ann,x\nc,ann,y\n")
    asked = ("--method", "majority", "--ties", "abstain", "--abstain-below", "0.7", "--out", str(out))
    document = aggregate(path, *asked)
    assert document["labels"] == str(out)
    assert document["accuracy"] is None
    assert (document["superseded"], document["abstained"]) == (1, 2)
    assert out.read_text() == "task,label\nb,\na,\nc,y\n"
    drawn = [
        aggregate(path, "--method", "majority", "--seed", seed)["labels"]
        for seed in ("0", "0", "1", "2", "3")
    ]
    assert drawn[0] == drawn[1] == {"b": drawn[0]["b"], "a": "y", "c": "y"}
    assert {labels["b"] for labels in drawn} == {"x", "y"}


@pytest.mark.real
def test_the_summary_names_the_least_reliable_workers(labels: Path, truth: Path) -> None:
    done = sfid("crowd", "aggregate", str(labels), "--method", "one-coin", "--truth", str(truth))
    lines = done.stdout.splitlines()
    assert (done.code, done.stderr) == (0, "")
    assert lines[0].startswith("one-coin: 30 tasks, 3 workers, 90 labels, 0 abstentions, ")
    assert lines[1:3] == ["accuracy 1.0000", "least reliable workers:"]
    assert lines[3].split()[0] == "cid"


@pytest.mark.real
@pytest.mark.parametrize(
    "arguments, named",
    [
        (("--method", "sorcery"), "crowd method 'sorcery' is unknown: choose one of majority, weighted"),
        (("--abstain-below", "1.5"), "abstain_below 1.5 is outside 0 to 1"),
        (("--ties", "maybe"), "--ties"),
        (("--method", "majority", "--prior", "1"), "majority has no prior in labels a class: leave it out"),
        (("--truth", "nowhere.csv"), "nowhere.csv: No such file"),
        (("--out", "/nowhere/out.csv"), "/nowhere/out.csv: No such file"),
    ],
)
def test_bad_usage_is_one_line_and_exit_code_two(
    labels: Path, arguments: tuple[str, ...], named: str
) -> None:
    done = sfid("crowd", "aggregate", str(labels), *arguments)
    assert (done.code, done.stdout, len(done.stderr.splitlines())) == (2, "", 1), done
    assert named in done.stderr


@pytest.mark.real
def test_a_truth_of_other_tasks_and_a_broken_row_are_refused(labels: Path, tmp_path: Path) -> None:
    other, broken = tmp_path / "other.csv", tmp_path / "broken.csv"
    other.write_text("task,label\nelsewhere,né\n")
    broken.write_text(HEADER + "t1,ann,x\nt2,ann\n")
    for arguments, named in (
        ((str(labels), "--truth", str(other)), "no task of the labels has a known truth"),
        ((str(broken),), f"{broken}, line 3: 2 cells under a header of 3"),
    ):
        done = sfid("crowd", "aggregate", *arguments)
        assert (done.code, done.stdout, len(done.stderr.splitlines())) == (2, "", 1), done
        assert named in done.stderr


@pytest.mark.parametrize(
    "content, named",
    [
        (b"", ": no rows: give a header task,worker,label"),
        (HEADER.encode(), ": no rows: give a header"),
        (b"task,worker\nt,w\n", ", line 1: the column 'label' is missing: begin the file with a header"),
        (b"\n\ntask,label,label,worker\n", ", line 3: the column 'label' is twice"),
        (HEADER.encode() + b"t,w,x\n\nt,w,x,y\n", ", line 4: 4 cells under a header of 3"),
        (HEADER.encode() + b"t,w,x\nt, ,x\n", ", line 3: the worker is empty: fill it in or delete the row"),
        (HEADER.encode() + b't,w,"x\ny\nz', ", line 4: unexpected end of data: close every quote"),
        (HEADER.encode() + b"t,w,x\nt,w,\xff\n", ", line 3: not UTF-8: save the file as UTF-8"),
        (HEADER.encode() + b"t,w," + b"x" * 200_000, ", line 2: field larger than field limit"),
    ],
)
def test_a_file_that_cannot_be_read_is_refused_with_line_and_mend(
    tmp_path: Path, content: bytes, named: str
) -> None:
    path = tmp_path / "labels.csv"
    path.write_bytes(content)
    with pytest.raises(CommandError) as refused:
        read_labels(path)
    assert str(refused.value).startswith(f"{path}{named}")
    assert refused.value.exit_code == 2


def test_columns_in_any_order_others_beside_them_and_signs_of_all_kinds_are_read(tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    path.write_bytes(
        '\ufeffLabel, when,TASK,worker\r\n"a\nb",1,t\u2028u,"w, v"\r\n0,2,t,w\r\n1,3,t,w\r\n'.encode()
    )
    assert read_labels(path) == Rows(["t\u2028u", "t"], ["w, v", "w"], ["a\nb", "1"], 1)


def test_two_truths_of_a_task_are_refused_unless_they_agree(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("task,label\nt,x\nt,x\nu,y\n")
    assert read_truth(path) == {"t": "x", "u": "y"}
    path.write_text("task,label\nt,x\nu,y\nt,y\n")
    with pytest.raises(CommandError, match="line 4: task 't' was 'x' and is now 'y': give each task one"):
        read_truth(path)


@pytest.mark.real
def test_real_labels_come_out_as_well_as_is_known_of_them() -> None:
    """0.8426 is what crowd-kit 1.4.2 reaches on this set with Dawid-Skene."""
    labels, truth = DATA / "dog-labels.csv", DATA / "dog-truth.csv"
    if not labels.exists():
        pytest.skip("the public label set 'dog' is not beside the project")
    document = aggregate(labels, "--method", "dawid-skene", "--truth", str(truth))
    with labels.open(newline="") as file:
        tasks = {row["task"] for row in csv.DictReader(file)}
    assert document["accuracy"] == pytest.approx(0.8426, abs=0.005)
    assert document["labels"].keys() == tasks
    assert len(document["workers"]) == 109
