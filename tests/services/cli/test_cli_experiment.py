"""`sfid experiment` and `sfid replay --method` as a person runs them."""

import json
from csv import DictReader
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

from services.cli.catalogue import meanings
from services.cli.shared.progress import Lines
from sfid_core.learning.guidance import GuidanceParameters
from tests.services.cli.command_line import alive, kill, running, sfid, wait_for

HOPELESS = "#####\n#@$ #\n# . #\n#####\n"


def document(*arguments: str) -> dict[str, Any]:
    done = sfid("experiment", *arguments, "--no-compile", "--json")
    assert done.code == 0, done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def test_figure2_tells_conditions_with_intervals_and_claims() -> None:
    told = document("figure2", "--seeds", "10")
    assert set(told) == {"seeds", "seconds", "sha256", "conditions", "claims", "files"}
    assert [(one["method"], one["teacher"]) for one in told["conditions"]] == [
        ("sfid", "expert"), ("reward", "expert"), ("sfid", "naive"), ("reward", "naive"),
    ]  # fmt: skip
    for one in told["conditions"]:
        for name in ("steps", "abs_td_error", "discounted_return", "inputs", "solved"):
            assert len(one[name]) == len(one[f"{name}_ci"]) == 30
    assert all({"claim", "holds", "difference", "ci"} <= set(claim) for claim in told["claims"])
    summed = [claim for claim in told["claims"] if claim["claim"].endswith("(nearest: sfid, naive)")]
    assert any("summed over an episode" in claim["claim"] for claim in summed)
    again = document("figure2", "--seeds", "10", "--workers", "1")
    assert again["sha256"] == told["sha256"]
    assert again["claims"] == told["claims"]


def test_learners_runs_on_one_two_and_three_boxes(tmp_path: Path) -> None:
    levels = ("room", "two-boxes", "three-boxes")
    flags = [part for level in levels for part in ("--level", level)]
    told = document("learners", "--seeds", "2", "--methods", "sfid", "--teachers", "oracle", *flags)
    assert [cell["level"] for cell in told["cells"]] == list(levels)
    for cell in told["cells"]:
        assert (cell["method"], cell["teacher"]) == ("sfid", "oracle")
        assert set(cell["success"]) == {"30", "100", "300"}
        for mean, lo, hi in (*cell["success"].values(), cell["inputs"]):
            assert lo <= mean <= hi
        assert cell["success"]["300"][0] > cell["success"]["30"][0]


def test_what_a_row_sets_otherwise_than_by_default_is_told_with_its_meaning() -> None:
    flags = ("--seeds", "2", "--teachers", "oracle", "--methods", "guide-judged,sfid")
    undo, width = document("learners", *flags)["settings"]
    assert undo == {
        "row": "guide-judged", "of": "guidance", "parameter": "undo", "value": "never", "default": "blamed",
        "range": "blamed, asked, never", "meaning": meanings(GuidanceParameters)["undo"],
    }  # fmt: skip
    assert (width["of"], width["parameter"], width["value"]) == ("its teachers", "guidance_width", 1)
    *_, undone, pointed, where = sfid("experiment", "learners", *flags, "--no-compile").stdout.splitlines()
    assert undone == f"guide-judged: guidance with undo never, not blamed: {undo['meaning']}"
    assert pointed == f"guide-judged: its teachers with guidance_width 1, not 2: {width['meaning']}"
    assert where.startswith("`sfid methods NAME` tells every parameter of a method, ")


def children(pid: int) -> list[int]:
    """The processes that a process started."""
    return [
        int(child)
        for task in Path(f"/proc/{pid}/task").iterdir()
        for child in (task / "children").read_text().split()
    ]


def test_an_experiment_that_is_killed_goes_on_where_it_was(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    run = ("experiment", "learners", "--methods", "sfid,dagger", "--teachers", "oracle",
           "--seeds", "60", "--no-compile", "--workers", "1", "--json")  # fmt: skip
    folder = tmp_path / "out"
    with running(*run, "--out", str(folder)) as process:
        wait_for("a finished chunk", lambda: any((folder / "chunks").glob("*.npy")))
        workers = children(process.pid)
        kill(process.pid)
        process.wait()
    assert workers
    wait_for("the end of the workers", lambda: not any(alive(worker) for worker in workers))
    before = {path.name: path.stat().st_mtime_ns for path in (folder / "chunks").glob("*.npy")}
    assert 0 < len(before) < 4
    resumed = sfid(*run, "--out", str(folder))
    assert resumed.code == 0, resumed.stderr
    after = {path.name: path.stat().st_mtime_ns for path in (folder / "chunks").glob("*.npy")}
    assert len(after) == 4
    assert {name: after[name] for name in before} == before
    told = json.loads(resumed.stdout)
    files = {Path(path).name for path in told["files"]}
    assert {"seeds.csv", "seeds.parquet", "learners-30.png", "learners-300.svg", "codebook.md"} <= files
    assert document(*run[1:-4])["sha256"] == told["sha256"]


def test_guidance_and_circuits_tell_their_claims() -> None:
    guidance = document("guidance", "--seeds", "10")
    assert {one["room"] for one in guidance["benefits"]} == {"4x4", "5x5", "6x6", "7x7"}
    assert all(one["ci"][0] <= one["ratio"] <= one["ci"][1] for one in guidance["benefits"])
    assert sum("grows with the room" in claim["claim"] for claim in guidance["claims"]) == 2
    circuits = document("circuits", "--seeds", "4")
    least = {(row["gamma"], row["omega"]): row["goal_reward_min"] for row in circuits["minima"]}
    assert least[0.9, "+1/-1"] == pytest.approx(1.8, abs=0.1)
    assert [one["trapped"] for one in circuits["cases"]][:2] == [True, True]


def test_a_sessions_configuration_runs_as_an_experiment_of_many_seeds() -> None:
    flags = ("--method", "tamer", "-p", "alpha=0.3", "--teacher", "noisy,rare", "--episodes", "7")
    told = document("session", *flags, "--seeds", "4")
    assert (told["method"], told["teacher"], told["seeds"]) == ("tamer", "noisy,rare", 4)
    assert len(told["steps"]) == len(told["steps_ci"]) == len(told["inputs"]) == 7
    assert document("session", *flags, "--seeds", "4", "--workers", "1")["sha256"] == told["sha256"]
    assert document("session", *flags[:-1], "6", "--seeds", "4")["steps"] == told["steps"][:6]


@pytest.mark.parametrize(
    "arguments,words",
    [
        (("session", "-p", "alpha=2"), "alpha 2.0 is outside (0, 1]"),
        (("session", "--method", "foo"), "unknown method 'foo': choose one of"),
        (("session", "--teacher", "foo"), "unknown teacher 'foo': choose from"),
        (("session", "--episodes", "0"), "episodes 0 is outside 1 to 1000000"),
        (("figure2", "--seeds", "1"), "seeds 1 is outside 2 to"),
        (("figure2", "--seed", "-1"), "seed -1 is outside 0 to 2^53-1"),
        (("figure2", "--workers", "-1"), "workers -1 is negative: 0 takes one a core"),
        (("figure2", "--starts", "500"), "starts: 500 asked for, but the level has only 192"),
        (("learners", "--methods", "sfid,foo"), "unknown method 'foo': choose from"),
        (("learners", "--teachers", "foo"), "unknown teacher 'foo': choose from"),
        (("learners", "--level", "nowhere"), "no level 'nowhere'"),
        (("learners", "--starts", "some"), "starts 'some' is unknown"),
    ],
)
def test_a_bad_option_is_one_line_with_the_mend(arguments: tuple[str, ...], words: str) -> None:
    done = sfid("experiment", *arguments)
    assert (done.code, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert words in done.stderr


@pytest.mark.parametrize("command", ["figure2", "learners", "circuits"])
def test_a_level_without_a_solution_is_refused(tmp_path: Path, command: str) -> None:
    path = tmp_path / "hopeless.xsb"
    path.write_text(HOPELESS)
    done = sfid("experiment", command, "--level", str(path))
    assert (done.code, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert "solv" in done.stderr


@pytest.mark.parametrize(
    "parameter,words",
    [
        ("alpha=0", "alpha 0.0 is outside (0, 1]: the default is 0.1"),
        ("alpha=2", "alpha 2.0 is outside (0, 1]"),
        ("gamma=1", "gamma 1.0 is outside [0, 1)"),
        ("explore=-0.1", "explore -0.1 is outside [0, 1]"),
        ("alhpa=0.1", "method sfid has no parameter 'alhpa': it has alpha"),
        ("omega=other", "omega 'other' is unknown: choose one of graded"),
        ("alpha", "parameter 'alpha' has no value: write NAME=VALUE"),
    ],
)
def test_a_bad_parameter_of_a_session_is_one_line_with_the_mend(parameter: str, words: str) -> None:
    done = sfid("session", "create", "s1", "-p", parameter)
    assert (done.code, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert words in done.stderr


@pytest.mark.real
def test_a_recorded_session_is_replayed_under_another_method(tmp_path: Path) -> None:
    data = str(tmp_path / "data")
    played = sfid("demo", "--no-viewer", "--json", "--episodes", "3", "--data", data)
    assert played.code == 0, played.stderr
    q_sha256 = json.loads(played.stdout)["q_sha256"]
    told = json.loads(sfid("replay", data, "--method", "sfid-memory", "-p", "alpha=0.2", "--json").stdout)
    assert (told["off_policy"], told["parameters"]) == (True, {"alpha": 0.2})
    (session,) = told["sessions"]
    assert (session["recorded"]["method"], session["recorded"]["q_sha256"]) == ("sfid", q_sha256)
    assert session["other"]["method"] == "sfid-memory"
    assert session["other"]["q_sha256"] != q_sha256
    assert 0 <= session["other"]["success"] <= 1
    itself = json.loads(sfid("replay", data, "--method", "sfid", "--json").stdout)
    assert itself["sessions"][0]["other"] == itself["sessions"][0]["recorded"]
    assert sfid("replay", data, "--method", "sfid").stdout.startswith("off-policy: ")
    again = document("session", "--from", data, "--seeds", "2", "--out", str(tmp_path / "again"))
    assert (again["method"], again["teacher"], len(again["steps"])) == ("sfid", "oracle", 3)
    with (tmp_path / "again" / "episodes.csv").open(encoding="utf-8") as file:
        first = [row for row in DictReader(file) if row["seed"] == "0"]
    lived = json.loads(played.stdout)["episodes"]
    assert [int(row["steps"]) for row in first] == [episode["steps"] for episode in lived]
    assert [int(row["inputs"]) for row in first] == [episode["inputs"] for episode in lived]
    for arguments, words in (
        (("--method", "reward"), "asks for reward, the session's sfid asked for label"),
        (("--method", "sfid", "--verify"), "leave out --method"),
        (("-p", "alpha=0.2"), "name it with --method"),
    ):
        done = sfid("replay", data, *arguments)
        assert (done.code, done.stdout, done.stderr.count("\n")) == (2, "", 1)
        assert words in done.stderr


def test_progress_is_a_line_now_and_then_where_no_bar_can_be_drawn() -> None:
    seconds = iter([0.0, 4.0, 10.0, 15.0, 20.0, 31.0])
    log = StringIO()
    told = Lines("seeds", lambda: next(seconds), 10.0, log)
    for done in (1, 100, 150, 200, 400):
        told(done, 400)
    assert log.getvalue() == ("seeds: 100 of 400, about 30 s left\nseeds: 200 of 400, about 20 s left\n")


def test_progress_is_told_although_one_piece_of_the_work_takes_long() -> None:
    seconds = iter([0.0, 9.0, 12.0, 24.0, 25.0, 30.0, 40.0, 60.0])
    log = StringIO()
    told = Lines("seeds", lambda: next(seconds), 10.0, log)
    told.beat()
    told.beat()
    told(0, 4)
    told(1, 4)
    told.beat()
    told.beat()
    told(4, 4)
    assert log.getvalue().splitlines() == [
        "seeds: begun, 12 s so far",
        "seeds: 0 of 4, 24 s so far",
        "seeds: 1 of 4, about 120 s left",
    ]


def test_guidance_and_circuits_draw_figures_and_learners_leaves_a_recording(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    runs = (
        (("guidance",), {"guidance.png", "guidance.svg", "guidance-steps.png", "guidance-steps.svg"}),
        (("circuits",), {"circuits.png", "circuits.svg"}),
        (("learners", "--methods", "sfid,reward", "--teachers", "oracle,rare"), {"learners.rrd"}),
    )
    for arguments, files in runs:
        folder = tmp_path / arguments[0]
        told = document(*arguments, "--seeds", "2", "--out", str(folder))
        assert files <= {Path(path).name for path in told["files"]}
        assert all((folder / name).stat().st_size > 1000 for name in files)


def test_a_folder_that_holds_another_experiment_is_left_alone(tmp_path: Path) -> None:
    first = ("experiment", "figure2", "--no-compile", "--out", str(tmp_path))
    assert sfid(*first, "--seeds", "2").code == 0
    before = {path.name: path.read_bytes() for path in tmp_path.glob("*.csv")}
    other = sfid(*first, "--seeds", "3")
    assert (other.code, other.stderr.count("\n")) == (2, 1)
    assert "holds another experiment (4 conditions, seeds 0 to 1): name a new folder" in other.stderr
    assert {path.name: path.read_bytes() for path in tmp_path.glob("*.csv")} == before
    assert sfid(*first, "--seeds", "2").code == 0
