"""Bugs that are planted into a copy of the packages, each with the rule whose checker has to find it."""

import json
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("sfid_core", "protocol", "services")
SEARCH = """
import json, sys
from services.simulate.campaign import campaign
first, seeds, rule = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
found = {"seed": None, "rules": [], "what": []}
for _, judged in campaign(first, seeds):
    if rule in {failure.rule for failure in judged.failures}:
        found = {
            "seed": judged.seed,
            "rules": sorted({failure.rule for failure in judged.failures}),
            "what": [failure.what for failure in judged.failures if failure.rule == rule],
        }
        break
print(json.dumps(found))
"""
LIMIT_S = 110


@dataclass(frozen=True)
class Bug:
    """A mutation of the text of one file, which is found by its text below `path`."""

    name: str
    rule: str
    path: str
    old: str
    new: str
    seeds: int = 48
    """It has to be found among the first so many seeds."""


@dataclass(frozen=True)
class Found:
    """What a search came to; `seed` is None when the bug was not found."""

    seed: int | None
    rules: tuple[str, ...]
    what: tuple[str, ...]


LEARNER = RECEPTION = "services/learner"
LOOP = "services/runtime/durable_loop.py"
MACHINE = "sfid_core/session"
ENVIRONMENT = "services/environment.py"

BUGS = (
    Bug(
        "an answer is acknowledged before its commit",
        "R1",
        LOOP,
        "        self._unsent.append((request, encode(reply)))\n",
        "        request.reply(encode(reply))\n",
    ),
    Bug(
        "a failed commit is taken for a good one and its rows are forgotten",
        "R1",
        LOOP,
        "            self._failed(error, [request for request, _ in unsent])\n            return\n",
        "            self.shard.discard_pending()\n",
    ),
    Bug(
        "another answer is journaled than the one that was sent",
        "R1",
        RECEPTION,
        "        body = answer_body(told.code, told.reason, kept)\n",
        "        body = answer_body(told.code, told.reason, kept.replace(b'LEFT', b'DOWN'))\n",
    ),
    Bug(
        "another content under the same id gets the acknowledgement of the first",
        "R2",
        RECEPTION,
        "        if before != kept:\n            at_ns",
        "        if before is None:\n            at_ns",
    ),
    Bug(
        "a repeated answer is told a code of its own",
        "R2",
        RECEPTION,
        "        self.desk.acknowledge(request, message, code, reason, row.seq)\n",
        "        self.desk.acknowledge(request, message, AnswerCode.SUPERSEDED, reason, row.seq)\n",
    ),
    Bug(
        "a closing by the clock is not journaled",
        "R3",
        LEARNER,
        "step_body(event, live.elapsed_at_ns)",
        "step_body(event, None)",
    ),
    Bug(
        "what is learnt depends on how often the learner was started",
        "R3",
        MACHINE,
        "    session.action = session.learner.choose(session.state, session.decision)\n",
        "    session.action = session.learner.choose(session.state, session.decision + session.epoch)\n",
    ),
    Bug(
        "the first answer of a teacher counts instead of the last",
        "R4",
        MACHINE,
        "    session.answers[event.teacher] = Given(event.answer, at_ns)\n",
        "    session.answers.setdefault(event.teacher, Given(event.answer, at_ns))\n",
    ),
    Bug(
        "an answer after the close is told to count",
        "R4",
        MACHINE,
        "        return (Acknowledge(event.answer_id, _too_late(session, at_ns, event, counted=counted)),)\n",
        "        return (Acknowledge(event.answer_id, AnswerCode.ACCEPTED),)\n",
    ),
    Bug(
        "an answer for another state is taken",
        "R5",
        MACHINE,
        "    if event.state != session.state:\n",
        "    if event.state == b'nowhere':\n",
    ),
    Bug(
        "an answer to an earlier decision is applied to the open one",
        "R5",
        MACHINE,
        "    if session.phase is not ASKING or event.decision != session.decision:\n        return False\n",
        "    if session.phase is not ASKING:\n        return False\n",
    ),
    Bug(
        "an overtaken answer still counts as pending",
        "R6",
        MACHINE,
        "        counts.pending -= 1\n",
        "        counts.pending -= 0\n",
    ),
    Bug(
        "late answers are not counted",
        "R6",
        MACHINE,
        "    session.counts.late += counted\n",
        "    session.counts.late += 0\n",
    ),
    Bug(
        "the environment executes a repeated decision again",
        "R7",
        ENVIRONMENT,
        "        if answered is not None and (request.decision, request.action) "
        "== (answered.decision, running.action):\n            return answered\n",
        "        if answered is not None and request.decision == answered.decision and running.world:\n"
        "            stood = (request.episode, request.step, request.state)\n"
        "            running.steps, running.state = request.step, request.state\n",
    ),
    Bug(
        "the window waits for teachers who have left",
        "R8",
        MACHINE,
        "    session.teachers.discard(event.teacher)\n",
        "",
    ),
    Bug(
        "an answer to a decision that comes again after a restart is rejected",
        "R8",
        RECEPTION,
        "        if _comes_again(live, message, event):\n",
        "        if message is None:\n",
        seeds=72,
    ),
    Bug(
        "an aggregator's worker is acknowledged before the commit",
        "R1",
        "services/runtime/front_desk.py",
        "        self._loop.reply_durably(request, reply)\n",
        "        request.reply(encode(reply))\n",
        seeds=72,
    ),
    Bug(
        "an answer that nobody acknowledged is taken for saved",
        "R8",
        "services/client/delivery.py",
        '            self._retry(sending, "no acknowledgement")\n',
        '            self._settle(sending, AnswerState.SAVED, "")\n',
    ),
    Bug(
        "some steps are not journaled",
        "R9",
        LEARNER,
        "            self.append(live, Kind.STEP, step_body(event, live.elapsed_at_ns), at_ns)\n",
        "            if event.decision % 7 != 6:\n"
        "                self.append(live, Kind.STEP, step_body(event, live.elapsed_at_ns), at_ns)\n",
    ),
    Bug(
        "an episode's steps go on where the last one ended",
        "R9",
        "protocol/translate.py",
        "        step=step.step,\n",
        "        step=step.decision,\n",
    ),
    Bug(
        "a report that somebody asks for moves the agent's chance",
        "R10",
        "services/learner/office.py",
        "        session = live.session\n        shown =",
        "        session, learner = live.session, live.session.learner\n"
        "        learner._draws = learner._draws._replace(ties=learner._draws.ties + 1)\n"
        "        shown =",
    ),
)


def plant(bug: Bug, directory: Path) -> Path:
    """Return a copy of the packages with the bug in it."""
    for package in PACKAGES:
        shutil.copytree(ROOT / package, directory / package, ignore=shutil.ignore_patterns("__pycache__"))
    below = directory / bug.path
    texts = {
        path: path.read_text(encoding="utf-8")
        for path in ([below] if below.is_file() else below.rglob("*.py"))
    }
    places = [path for path, text in texts.items() if text.count(bug.old) == 1]
    assert len(places) == 1, f"{bug.path} has changed: plant {bug.name!r} elsewhere"
    places[0].write_text(texts[places[0]].replace(bug.old, bug.new), encoding="utf-8")
    return directory


def search(bug: Bug, directory: Path) -> Found:
    """Look for the bug in the copy, with its rule's checker."""
    command = [sys.executable, "-c", SEARCH, "0", str(bug.seeds), bug.rule]
    done = subprocess.run(
        command, cwd=directory, capture_output=True, text=True, timeout=LIMIT_S, check=False,
        env={"PYTHONPATH": str(directory), "PYTHONDONTWRITEBYTECODE": "1", "PATH": "/usr/bin:/bin"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    return Found(found["seed"], tuple(found["rules"]), tuple(found["what"]))
