"""Metrics say what the journal says, and a scrape is all that they cost."""

import urllib.request
from collections import Counter
from contextlib import ExitStack
from pathlib import Path

import pytest

pytest.importorskip("prometheus_client")

from prometheus_client.parser import text_string_to_metric_families

from protocol.journal import read_answer_body
from protocol.keys import Keys
from protocol.messages import LabelTotals
from protocol.status_message import ServiceStatus
from services.operations.metrics import Exporter
from services.operations.status import Found
from services.router import free_endpoint
from services.runtime.journal import read_rows
from tests.services.cli.command_line import running, sfid, wait_for

KEYS = Keys()
LEARNER = {"deployment": "local", "role": "learner", "name": "shard-0"}


def scraped(port: int) -> dict[tuple[str, str], float]:
    """Return values by metric and its last label (of a learner)."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=20) as page:
        text = page.read().decode()
    found: dict[tuple[str, str], float] = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            if sample.labels.get("role") == "learner":
                extra = [value for key, value in sample.labels.items() if key not in LEARNER]
                found[sample.name, extra[0] if extra else ""] = sample.value
    return found


def test_every_count_of_a_status_is_a_metric() -> None:
    labels = LabelTotals(
        submitted=15, acknowledged=15, applied=5, superseded=4, late=3, rejected=2, pending=1
    )
    status = ServiceStatus(
        role="learner", name="shard-0", version="1", pid=1, uptime_ms=7, backlog=6, sessions=2, running=1,
        teachers=9, labels=labels, refused={"malformed": 8}, commits=(1, 0, 2, 0, 0, 0, 0, 0, 0, 1),
        commit_us=2_500_000,
    )  # fmt: skip
    found = [Found("local", "learner", "shard-0", status), Found("local", "gateway", "0", None, "gone")]
    exporter = Exporter("127.0.0.1", 0, lambda: found)
    try:
        seen = scraped(exporter.port)
    finally:
        exporter.close()
    answers = {became: value for (name, became), value in seen.items() if name == "sfid_answers_total"}
    assert answers == {"applied": 5, "superseded": 4, "late": 3, "rejected": 2, "pending": 1}
    assert sum(answers.values()) == labels.submitted
    assert seen["sfid_refused_total", "malformed"] == 8
    gauges = {
        name: seen[f"sfid_{name}", ""] for name in ("ready", "backlog", "sessions", "running", "teachers")
    }
    assert gauges == {"ready": 1, "backlog": 6, "sessions": 2, "running": 1, "teachers": 9}
    buckets = {bound: value for (name, bound), value in seen.items() if name == "sfid_commit_seconds_bucket"}
    assert (buckets["0.00025"], buckets["0.001"], buckets["1"], buckets["+Inf"]) == (1, 3, 3, 4)
    assert (seen["sfid_commit_seconds_sum", ""], seen["sfid_commit_seconds_count", ""]) == (2.5, 4)


@pytest.mark.real
def test_the_metrics_of_a_deployment_add_up_to_its_journal(tmp_path: Path) -> None:
    endpoint, data = free_endpoint(), tmp_path / "data"
    common = ("--connect", endpoint)
    with ExitStack() as stack:
        up = stack.enter_context(
            running(
                "up", "--data", str(data), "--listen", endpoint, "--no-viewer", stderr=tmp_path / "up.log"
            )
        )
        assert up.stdout is not None
        while not (line := up.stdout.readline()).startswith("next: "):
            assert line, (tmp_path / "up.log").read_text()
        for session in ("s1", "s2"):
            made = sfid("session", "create", session, *common, "--level", "room", "--episodes", "2")
            assert made.code == 0, made.stderr
            taught = sfid("teach", "scripted", "--session", session, *common)
            assert taught.code == 0, taught.stderr
        log = tmp_path / "metrics.log"
        served = stack.enter_context(running("metrics", "--listen", "127.0.0.1:0", *common, stderr=log))
        port = _port(log)
        seen = scraped(port)
        served.terminate()
        assert served.wait(10) == 0
        up.terminate()
        up.wait(30)
    codes = Counter(
        read_answer_body(row.body)[0].value for row in read_rows(data) if row.kind == "answer" and row.body
    )
    answers = {became: int(value) for (name, became), value in seen.items() if name == "sfid_answers_total"}
    assert sum(answers.values()) == sum(codes.values()) > 0
    assert answers["rejected"] == codes["rejected"]
    assert answers["applied"] + answers["superseded"] + answers["pending"] >= codes["accepted"]
    assert seen["sfid_sessions", ""] == 2
    assert seen["sfid_commit_seconds_count", ""] > 0


def _port(log: Path) -> int:
    wait_for("it serves", lambda: "/metrics" in log.read_text())
    return int(log.read_text().partition("ready: http://127.0.0.1:")[2].partition("/")[0])


def test_others_reach_the_page_only_where_that_was_said() -> None:
    done = sfid("metrics", "--listen", "0.0.0.0:9464")
    assert (done.code, done.stderr.count("\n"), "--insecure-bind" in done.stderr) == (2, 1, True)
    assert sfid("metrics", "--listen", "nowhere").code == 2
