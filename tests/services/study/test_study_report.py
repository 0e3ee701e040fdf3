"""Eight participants in two conditions, and the report that their data gives (ring 3)."""

import csv
import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from typer.testing import CliRunner

from services.cli.main import app
from tests.services.study.participants import Participant, Running, running, study_file

pytestmark = pytest.mark.real
PEOPLE = 8
ERASED = 7
QUESTIONS = """
[[questions]]
name = "hand"
kind = "choice"
text = "Which hand do you write with?"
choices = ["left", "right"]
[[questions]]
name = "more"
kind = "text"
text = "Anything else?"
required = false
"""
LABELS_RATED, REWARDS_RATED = (30, 5, 20, 10, 25, 0), (60, 10, 40, 30, 55, 45)


def whole_way(person: Participant) -> None:
    person.agree()
    person.press("go")
    person.teach()
    person.press("go")
    assert person.teach() == "effort-1"
    person.rate(*(LABELS_RATED if person.asked == {"label"} else REWARDS_RATED))
    assert person.press("answer", hand="left", more="") == "done"


@pytest.fixture(scope="module")
def taught(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A study that eight people have gone through, the last of whom had their answers deleted."""
    folder = tmp_path_factory.mktemp("report")
    with running(study_file(folder, extra=QUESTIONS), folder / "data") as started:
        people = [started.participant(number) for number in range(PEOPLE)]
        with ThreadPoolExecutor(PEOPLE) as pool:
            list(pool.map(whole_way, people))
        assert people[ERASED].press("stop-delete") == "erased"
        yield started


def sfid(*arguments: str) -> str:
    result = CliRunner().invoke(app, ["study", *arguments])
    assert result.exit_code == 0, result.output
    return result.stdout


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_status_counts_people_by_step_and_condition(taught: Running) -> None:
    found = json.loads(sfid("status", str(taught.file), "--data", str(taught.data), "--json"))
    counts = found["conditions"]
    assert set(counts) == {"labels", "rewards"}
    assert found["opened"] == PEOPLE
    assert sum(row.get("completed", 0) for row in counts.values()) == PEOPLE - 1
    assert sorted(sum(row.values()) for row in counts.values()) == [4, 4]
    assert len(found["to_erase"]) == 1
    assert len(set(found["codes"].values())) == len(found["codes"]) == PEOPLE - 1


def test_the_report_has_the_figure_the_effort_the_tables_and_claims_nothing_of_eight(
    taught: Running, tmp_path: Path
) -> None:
    command = ("report", str(taught.file), "--data", str(taught.data), "--out", str(tmp_path), "--json")
    found = json.loads(sfid(*command))
    assert sorted(found["people"].values()) == [3, 4]
    assert {claim["verdict"] for claim in found["claims"]} == {"too few people to say"}
    assert not any(claim["holds"] for claim in found["claims"])
    effort = next(
        claim for claim in found["claims"] if claim["claim"].endswith("differ in effort (raw score)")
    )
    assert effort["means"] == pytest.approx([15.0, 40.0])
    assert {Path(name).name for name in found["files"]} == {
        *(f"{name}.{ending}" for ending in ("csv", "parquet")
          for name in ("participants", "lessons", "episodes", "curves", "effort", "claims", "answers")),
        "codebook.md", "codebook.json", "figure2.png", "figure2.svg", "effort.png", "effort.svg",
        "report.html",
    }  # fmt: skip
    people, episodes = rows(tmp_path / "participants.csv"), rows(tmp_path / "episodes.csv")
    assert len(people) == PEOPLE - 1
    assert len(episodes) == 3 * (PEOPLE - 1)
    assert {row["standing"] for row in people} == {"completed"}
    status = json.loads(sfid("status", str(taught.file), "--data", str(taught.data), "--json"))
    page = (tmp_path / "report.html").read_text()
    assert "Too few people for claims" in page
    assert "<script" not in page
    assert not any(status["to_erase"][0] in path.read_text() for path in tmp_path.glob("*.csv"))
    given = [(row["hand"], row["more"]) for row in rows(tmp_path / "answers.csv")]
    assert given == [("left", "")] * (PEOPLE - 1)
    ratings = {row["condition"]: row["effort_raw"] for row in rows(tmp_path / "lessons.csv")}
    assert ratings == {"labels": "15.0", "rewards": "40.0"}


def test_the_same_data_give_the_same_bytes(taught: Running, tmp_path: Path) -> None:
    for folder in (tmp_path / "one", tmp_path / "two"):
        sfid("report", str(taught.file), "--data", str(taught.data), "--out", str(folder))
    first, second = (
        {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
        for folder in (tmp_path / "one", tmp_path / "two")
    )
    assert first == second
