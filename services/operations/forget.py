"""Forgetting a person: their bytes are erased, and what was learnt is what others alone would have taught."""

from collections import defaultdict
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from protocol.crowd_forget import corrected_answers, forget_in_crowd
from protocol.forgetting import Corrections, Forgotten, forget_in_session, is_alone_in
from protocol.journal import Record
from services.operations.loose_files import Loose, loose_files
from services.operations.withdrawal import revoke_person
from services.runtime.clock import Clock
from services.runtime.journal import Shard, shard_directories

Rows = list[tuple[int, Record]]


@dataclass(slots=True)
class Forgetting:
    """What was, or with a dry run would be, erased of a person."""

    person: str
    sessions: dict[str, Forgotten] = field(default_factory=dict)
    """Of the learner, by name: those in which something changes."""
    crowd_rows: int = 0
    study_rows: int = 0
    rows: int = 0
    """All rows that lose their bytes."""
    loose: Loose = field(default_factory=Loose)
    revoked: bool = False
    """Whether tokens of the person, which the deployment may have given out, are worthless from now on."""

    @property
    def answers(self) -> int:
        """How many answers to the learner were the person's."""
        return sum(one.answers for one in self.sessions.values())


def forget(
    data: Path,
    person: str,
    clock: Clock,
    session: str | None = None,
    *,
    dry_run: bool = False,
    recordings: bool = False,
) -> Forgetting:
    """Erase a person from every journal below a data directory, or tell what that would come to.

    The learner's journal first, because what a crowd handed on is corrected from the crowd's rows; so after a
    kill at any moment, saying it again does the rest.

    Args:
        data: the directory; no service may own it.
        person: the pseudonym.
        clock: dates the rows that say what is read instead.
        session: only in this one; then files that do not belong to a session stay.
        dry_run: change nothing.
        recordings: also remove recordings of the sessions, and exports that may name the person.

    Raises: JournalLocked while a service owns a journal (tokens are then revoked all the same); JournalError;
    SecretError; DecodeError.
    """
    found = Forgetting(person)
    if not dry_run:
        # First of all, and before anything can fail: a withdrawal takes effect at once.
        found.revoked = revoke_person(data, person, session)
    with ExitStack() as stack:
        learner = [stack.enter_context(opened) for opened in _shards(data)]
        crowds = [stack.enter_context(one) for path in sorted(data.glob("crowd-*")) for one in _shards(path)]
        studies = [stack.enter_context(one) for path in sorted(data.glob("study-*")) for one in _shards(path)]
        corrections = _corrections(crowds, person, session)
        for shard in learner:
            _in_learner(shard, found, corrections, clock, session, dry_run=dry_run)
        for shard in crowds:
            plan = {name: forget_in_crowd(rows, person) for name, rows in _by_session(shard, session).items()}
            found.crowd_rows += _erase(shard, plan, clock, dry_run=dry_run)
        for shard in studies:
            plan = {name: _of_person(shard, name, person) for name in shard.sessions()} if not session else {}
            found.study_rows += _erase(shard, plan, clock, dry_run=dry_run)
        found.rows += found.crowd_rows + found.study_rows
        found.loose = loose_files(
            data, person, found.sessions, everywhere=session is None, dry_run=dry_run, recordings=recordings
        )
    return found


def _shards(data: Path) -> Iterable[Shard]:
    for directory in shard_directories(data):
        yield Shard.open(data, int(directory.name.removeprefix("shard-")))


def _in_learner(
    shard: Shard,
    found: Forgetting,
    corrections: Corrections,
    clock: Clock,
    session: str | None,
    *,
    dry_run: bool,
) -> None:
    plan: dict[str, dict[int, bytes | None]] = {}
    renamed: dict[str, str] = {}
    for name, rows in _by_session(shard, session).items():
        forgotten = forget_in_session(rows, found.person, corrections)
        if forgotten is not None and is_alone_in(name, rows, found.person):
            forgotten.amendments = {seq: None for seq, _ in rows}
            renamed[name] = f"{_erased_name(shard)}-{rows[0][0]}"
        if forgotten is not None and forgotten.amendments:
            found.sessions[name] = forgotten
            plan[name] = forgotten.amendments
    found.rows += _erase(shard, plan, clock, renamed, dry_run=dry_run)


def _erased_name(shard: Shard) -> str:
    """Return what begins the name of an erased session: rows are numbered in each shard anew."""
    number = shard.directory.name.removeprefix("shard-")
    return "erased" if number == "0" else f"erased-{number}"


def _erase(
    shard: Shard,
    plan: dict[str, dict[int, bytes | None]],
    clock: Clock,
    renamed: dict[str, str] | None = None,
    *,
    dry_run: bool,
) -> int:
    plan = {name: amendments for name, amendments in plan.items() if amendments}
    if dry_run:
        return sum(map(len, plan.values()))
    return shard.erase(plan, at_ns=clock.wall_ns(), renamed=renamed)


def _by_session(shard: Shard, session: str | None) -> dict[str, Rows]:
    found: dict[str, Rows] = defaultdict(list)
    for row in shard.rows(session):
        if row.body is not None:
            found[row.session].append((row.seq, Record(row.kind, row.at_ns, row.body)))
    return found


def _of_person(shard: Shard, session: str, person: str) -> dict[int, bytes | None]:
    return {row.seq: None for row in shard.rows(session) if row.person == person and row.body is not None}


def _corrections(crowds: list[Shard], person: str, session: str | None) -> Corrections:
    return {
        one.before.answer_id: one.after
        for shard in crowds
        for rows in _by_session(shard, session).values()
        for one in corrected_answers((record for _, record in rows), {person})
    }
