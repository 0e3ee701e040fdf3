"""Logs: a line for people, a document for programs, both with the ids that lead from log to log."""

import json
import os
import subprocess
import sys

import pytest

SAYS = """
import logging
from services.runtime.log_config import about, configure
configure("learner", verbose=True)
log = logging.getLogger("sfid.test")
log.debug("answer journaled", extra=about(session="s1", decision=7, answer_id=b"\\xab\\xcd"))
try:
    1 / 0
except ZeroDivisionError:
    log.exception("two\\nlines")
"""


def logged(format_: str) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-c", SAYS], env=os.environ | {"SFID_LOG_FORMAT": format_}, capture_output=True,
        text=True, check=True, timeout=30,
    )  # fmt: skip
    return done.stderr.splitlines()


def test_each_event_is_one_json_document_with_its_ids() -> None:
    said, failed = map(json.loads, logged("json"))
    assert {key: said[key] for key in said if key not in {"at", "pid"}} == {
        "level": "debug", "role": "learner", "logger": "sfid.test", "message": "answer journaled",
        "session": "s1", "decision": 7, "answer_id": "abcd",
    }  # fmt: skip
    assert said["at"].endswith("Z")
    assert (failed["message"], "ZeroDivisionError" in failed["exception"]) == ("two\nlines", True)


@pytest.mark.parametrize("format_", ["text", "nonsense"])
def test_people_read_a_line_that_ends_with_the_ids(format_: str) -> None:
    line = logged(format_)[0]
    assert line.endswith("answer journaled session=s1 decision=7 answer_id=abcd")
    assert " DEBUG   learner[" in line
