"""`sfid simulate` and what it stands on: a seed is one run to the byte, and faults do happen in it."""

import gc
import json
import logging
import os
import subprocess
import sys
from hashlib import blake2b
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import pytest

from protocol.codec import decode, encode
from protocol.messages import Acknowledgement, Answer
from services.simulate.campaign import SLACK, calm, campaign, judge
from services.simulate.disk import Fate
from services.simulate.evidence import Evidence, Kept, Told, gather
from services.simulate.model import Table, moved, opinion, verdict
from services.simulate.rules import r1_acknowledged_is_kept, r2_same_id_same_acknowledgement
from services.simulate.scenario import LESSONS, Lesson, What, lesson, scenario, undisturbed
from services.simulate.stage import History, Stage
from services.simulate.trace import line
from tests.simulation.planted import BUGS, plant

SEED = 5
ANSWER: dict[str, Any] = {
    "answer_id": bytes(16), "session": "s1", "teacher": "bob", "epoch": 1, "decision": 1, "episode": 0,
    "step": 1, "state": bytes(16), "kind": "label", "action": "LEFT", "response_ms": 0,
}  # fmt: skip


def sfid(*arguments: str, where: Path | None = None) -> subprocess.CompletedProcess[str]:
    environment = dict(os.environ) if where is None else dict(os.environ) | {"PYTHONPATH": str(where)}
    return subprocess.run(
        [sys.executable, "-m", "services.cli.main", "simulate", *arguments],
        capture_output=True, text=True, timeout=100, check=False, cwd=where, env=environment,
    )  # fmt: skip


def test_the_same_seed_is_the_same_run_to_the_byte_and_another_seed_another() -> None:
    first, again, other = judge(SEED, trace=True), judge(SEED, trace=True), judge(SEED + LESSONS, trace=True)
    assert first == again
    assert first.seen == again.seen
    assert first.trace_sha256 != other.trace_sha256


def test_a_run_leaves_the_log_of_its_process_and_the_search_for_garbage_as_they_were(
    caplog: pytest.LogCaptureFixture,
) -> None:
    judge(SEED)
    gc.disable()
    try:
        judge(SEED)
        assert not gc.isenabled()
    finally:
        gc.enable()
    with caplog.at_level(logging.INFO):
        logging.getLogger("sfid.learner").info("heard again")
    assert (caplog.messages, gc.isenabled()) == (["heard again"], True)


def test_a_run_without_faults_meets_none(tmp_path: Path) -> None:
    history = Stage(undisturbed(lesson(SEED)), tmp_path).play()
    assert history.faults == 0
    assert history.report is not None
    assert history.unacknowledged == {}


def test_all_kinds_of_trials_lessons_and_disk_fates_are_drawn() -> None:
    assert {trial.what for seed in range(200) for trial in scenario(seed).trials} == set(What)
    methods = {lesson(number).config.method for number in range(LESSONS)}
    modes = {lesson(number).config.window.mode for number in range(LESSONS)}
    assert methods == {"sfid", "reward", "q-learning"}
    assert modes == {"until-answered", "early", "full"}
    assert len(Fate) == 8


def test_a_campaign_is_the_same_whoever_shares_the_seeds() -> None:
    *_, (alone, _) = campaign(0, 16)
    *_, (shared, _) = campaign(0, 16, jobs=2)
    alone.seconds = shared.seconds
    assert alone == shared
    assert (alone.seeds, alone.failures) == (16, [])
    assert alone.faults > 16


def test_one_json_document_says_what_came_of_the_seeds() -> None:
    done = sfid("--seeds", "6", "--seed", "3", "--json", "--jobs", "1")
    document = json.loads(done.stdout)
    assert (done.returncode, document["ok"], document["seeds"], document["failures"]) == (0, True, 6, [])
    assert set(document) == {
        "seeds", "ok", "failures", "steps", "events", "faults", "seconds", "trace_sha256"
    }  # fmt: skip
    assert document["steps"] > 0


def test_a_long_lesson_has_three_teachers_and_at_least_the_decisions_that_were_asked_for() -> None:
    drawn = scenario(SEED, 60)
    judged = judge(SEED, 60)
    assert len(drawn.lesson.teachers) == 3
    assert judged.failures == ()
    assert 60 <= judged.decisions <= judged.steps


@pytest.mark.parametrize("number", [3, 8])
def test_a_long_lesson_is_hardly_longer_than_asked(number: int) -> None:
    taught, longest = calm(number, 60).lesson, lesson(number, 60)
    wanted = 60 if taught.exact else 60 * SLACK
    assert taught.config.episodes < longest.config.episodes
    assert wanted <= decisions_of(taught) < wanted + taught.config.world.steps_max


def decisions_of(taught: Lesson) -> int:
    with TemporaryDirectory() as root:
        return len(gather(Stage(undisturbed(taught), Path(root)).play()).transitions())


def test_a_failure_is_told_with_the_command_that_repeats_it_and_exit_1(tmp_path: Path) -> None:
    bug = next(bug for bug in BUGS if bug.name == "some steps are not journaled")
    where = plant(bug, tmp_path)
    done = sfid("--seeds", "1", "--json", where=where)
    failures = json.loads(done.stdout)["failures"]
    assert done.returncode == 1
    assert failures[0]["seed"] == 0
    assert failures[0]["repeat"] == "sfid simulate --seed 0 --trace"
    repeated = sfid("--seed", "0", "--trace", "--json", where=where)
    assert json.loads(repeated.stdout)["failures"] == failures
    assert "publish    learner" in repeated.stderr


def test_every_event_is_one_readable_line() -> None:
    lines = [line(seen) for seen in judge(SEED, trace=True).seen]
    assert len(lines) > 100
    assert all("\n" not in text and text.isprintable() for text in lines)


@pytest.mark.parametrize(
    "view, action, after",
    [
        ("#####\n#@$ #\n#####", "RIGHT", "#####\n# @$#\n#####"),
        ("#####\n#@$.#\n#####", "RIGHT", "#####\n# @*#\n#####"),
        ("#####\n#+*.#\n#####", "RIGHT", "#####\n#.+*#\n#####"),
        ("#####\n#@$$#\n#####", "RIGHT", "#####\n#@$$#\n#####"),
        ("#####\n#@$ #\n#####", "UP", "#####\n#@$ #\n#####"),
        ("###\n#.#\n#@#\n###", "UP", "###\n#+#\n# #\n###"),
    ],
)
def test_the_model_moves_as_sokoban_does(view: str, action: str, after: str) -> None:
    assert moved(view, action) == after


def test_the_model_counts_votes() -> None:
    assert opinion([]) is None
    assert opinion(["UP", "DOWN"]) is None
    assert opinion(["UP", "DOWN", "UP"]) == "UP"
    assert verdict([]) == 0.0
    assert verdict([1.0, -1.0]) == 0.0
    assert verdict([1.0, 0.5, -1.0]) == 0.75


def test_the_model_learns_a_case_computed_by_hand() -> None:
    table = Table(0.5, 0.5)
    table.learn(b"a" * 16, "UP", 1.0, 1.0, None)
    table.learn(b"b" * 16, "LEFT", 0.0, -1.0, b"a" * 16)
    again = Table(0.5, 0.5)
    again.learn(b"b" * 16, "LEFT", -0.5, 0.0, None)
    again.learn(b"a" * 16, "UP", 2.0, 0.0, None)
    assert table.sha256() == again.sha256()


def test_an_operator_who_is_refused_waits_and_a_disk_that_fails_is_outlived() -> None:
    """Two seeds whose operator once asked again at once, until the run was cut off as endless."""
    assert [judge(seed).failures for seed in (21_080, 21_882)] == [(), ()]


def test_a_damaged_answer_that_reads_as_the_same_with_a_token_is_the_same_answer() -> None:
    """Of seed 342 a frame was cut before its last byte, and three random bytes behind it were a text."""
    assert judge(342, 200).failures == ()
    plain, broken = Answer(**ANSWER), encode(Answer(**ANSWER))[:-1] + b"\xa2ie"
    assert msgspec.structs.replace(decode(broken, Answer), token=None) == plain
    told = Acknowledgement(
        answer_id=plain.answer_id, code="accepted", reason="", epoch=1, journal_seq=1,
        check=blake2b(broken, digest_size=8).digest(),
    )  # fmt: skip
    evidence = Evidence(History(scenario(SEED)), kept=[Kept(1, "accepted", encode(plain), plain)])
    for content, failures in ((encode(plain), 0), (b"another", 2)):
        evidence.told = [Told(broken, told, content)]
        found = [*r1_acknowledged_is_kept(evidence), *r2_same_id_same_acknowledgement(evidence)]
        assert len(found) == failures


def test_a_long_lesson_meets_at_least_twenty_trials_and_one_teacher_leaves_at_most() -> None:
    drawn = [scenario(seed, 200) for seed in range(100)]
    assert {len(one.trials) for one in drawn} == {20}
    assert {one.lesson.teachers for one in drawn} == {("ann", "bob", "cyd")}
    assert {one.lesson.config.method for one in drawn} == {"sfid", "reward"}
    assert {sum(trial.what is What.LEAVE for trial in one.trials) for one in drawn} == {0, 1}
