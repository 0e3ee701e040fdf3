"""`sfid methods` and `sfid teachers`: what a researcher chooses from, and the README's table of it."""

import json
import re
from pathlib import Path

from services.cli.catalogue import meanings
from sfid_core.learning.methods import METHODS
from sfid_core.teaching.kernels import TeacherParameters
from sfid_core.teaching.personas import PERSONAS
from tests.services.cli.command_line import sfid

README = Path(__file__).parents[3] / "README.md"


def test_every_method_is_listed_with_what_it_asks_and_its_source() -> None:
    listed = json.loads(sfid("methods", "--json").stdout)
    assert [row["method"] for row in listed] == list(METHODS)
    (guidance,) = (row for row in listed if row["method"] == "guidance")
    assert guidance["asks"] == ["guidance", "reward"]
    assert all(row["source"] and row["summary"] for row in listed)


def test_a_method_shows_its_parameters_with_range_and_default() -> None:
    document = json.loads(sfid("methods", "sfid", "--json").stdout)
    (alpha,) = (row for row in document["parameters"] if row["name"] == "alpha")
    assert (alpha["value"], alpha["range"]) == (0.1, "(0, 1]")
    shown = sfid("methods", "sfid")
    assert shown.code == 0
    said = " ".join(shown.stdout.split())
    assert "graded, centred, penalty" in said
    assert "parameter default range or choices meaning" in said
    assert sfid("methods").stdout.splitlines()[-1].startswith("`sfid methods NAME` tells its parameters: ")


def test_every_parameter_of_every_method_and_teacher_says_what_it_means() -> None:
    kinds = {method.parameters for method in METHODS.values()} | {TeacherParameters}
    dumb = [
        f"{kind.__name__}.{name}" for kind in kinds for name in kind._fields if not meanings(kind).get(name)
    ]
    assert dumb == []
    told = {meaning: kind.__name__ for kind in kinds for meaning in meanings(kind).values()}
    named = [(told[meaning], name) for meaning in told for name in re.findall(r"[Ss]ee `([^`]+)`", meaning)]
    assert [one for one in named if one[1] not in METHODS] == []  # and not into the code
    document = json.loads(sfid("methods", "pies", "--json").stdout)
    (beta,) = (row for row in document["parameters"] if row["name"] == "beta")
    assert (beta["meaning"], beta["source"]) == (
        "Step size of the advice Phi.", "the authors' 20 x 20 grid",
    )  # fmt: skip
    teacher = json.loads(sfid("teachers", "naive", "--json").stdout)
    (error,) = (row for row in teacher["parameters"] if row["name"] == "reward_error")
    assert (error["value"], error["range"]) == (0.35, "[0, 1]")
    assert error["meaning"].startswith("Share of judgements that are mistaken")
    assert "Step size of the advice Phi. (the authors' 20" in " ".join(sfid("methods", "pies").stdout.split())


def test_every_teacher_is_listed_and_shows_its_faults() -> None:
    assert [row["teacher"] for row in json.loads(sfid("teachers", "--json").stdout)] == list(PERSONAS)
    naive = json.loads(sfid("teachers", "naive", "--json").stdout)
    assert naive["faults"]["reward_error"] == 0.35


def test_an_unknown_name_is_refused_with_what_there_is() -> None:
    for verb in ("methods", "teachers"):
        done = sfid(verb, "nobody")
        assert (done.code, done.stderr.count("\n")) == (2, 1)
        assert "choose one of" in done.stderr


def test_the_readme_names_every_method_and_teacher() -> None:
    text = README.read_text(encoding="utf-8")
    missing = [name for name in (*METHODS, *PERSONAS) if f"`{name}`" not in text]
    assert missing == []
