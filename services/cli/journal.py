"""`sfid replay` and `sfid verify`: what a journal tells, and whether it is whole."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from protocol.codec import DecodeError
from services.cli.shared.failure import NOT_SO, CommandError
from services.cli.shared.options import Json, Parameter, given_parameters, print_json
from services.cli.shared.recorded import no_such_session
from services.replay import Replayed, ReplayedCrowd, replay_crowds, replay_directory
from services.runtime.journal import verify as verify_journal
from sfid_core.learning.parameters import Value

if TYPE_CHECKING:
    from services.experiments.other_method import Misfit


def add_to(app: typer.Typer) -> None:
    """Add the journal commands."""
    app.command()(replay)
    app.command()(verify)


DirectoryArgument = Annotated[Path, typer.Argument(help="Data directory of a learner.")]


def replay(
    directory: DirectoryArgument,
    session: Annotated[str | None, typer.Option(help="Only this session.")] = None,
    verify: Annotated[
        bool,
        typer.Option("--verify", help="Exit 1 when a noted digest, or what a teacher was told, differs."),
    ] = False,
    method: Annotated[
        str | None, typer.Option(help="What this method would have learnt from the same steps and answers.")
    ] = None,
    parameter: Parameter = None,
    json: Json = False,
) -> None:
    """Rebuild Q and crowds from their journals alone and compare them with what was noted."""
    if method is not None:
        _replay_with(directory, session, method, given_parameters(parameter), verify=verify, json=json)
        return
    if parameter:
        message = "-p sets a parameter of another method: name it with --method"
        raise CommandError(message)
    try:
        replayed = replay_directory(directory, session)
        crowds = replay_crowds(directory, session)
    except DecodeError as error:
        message = f"{directory}: a row cannot be read ({error}): `sfid verify {directory}` tells where"
        raise CommandError(message, NOT_SO) from None
    if not replayed:
        raise no_such_session(directory, session)
    if json:
        print_json(
            {"sessions": [_row(one) for one in replayed], "crowds": [_crowd_row(one) for one in crowds]}
        )
    else:
        for one in replayed:
            same = (
                f"matches {_count(one.digests, 'noted digest')}" if one.digests else "nothing to compare yet"
            )
            verdict = same if one.matches else "DIFFERS"
            counts = f"{_count(one.events, 'event')}, {_count(one.episodes, 'episode')}"
            erased = f", {one.erased} answers erased" if one.erased else ""
            print(f"{one.session}: {counts}{erased}, q_sha256 {one.q_sha256}: {verdict}")
        for crowd in crowds:
            verdict = "matches what was handed on" if crowd.matches else "DIFFERS"
            counts = f"{crowd.conclusions} conclusions of {len(crowd.reliabilities)} workers"
            print(f"{crowd.session}, crowd {crowd.aggregator}: {counts}: {verdict}")
    if verify and not (all(one.matches for one in replayed) and all(one.matches for one in crowds)):
        raise typer.Exit(NOT_SO)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


OFF_POLICY = (
    "off-policy: the recorded method chose every step, and the teacher answered what it did; under its own "
    "choices the other method would have met other states and had other answers"
)


def _replay_with(
    directory: Path,
    session: str | None,
    method: str,
    given: dict[str, Value],
    *,
    verify: bool,
    json: bool,
) -> None:
    """Print what another method would have learnt from the recorded steps and answers."""
    from services.experiments.other_method import Misfit, replay_with

    if verify:
        message = "--verify compares with what was noted under the recorded method: leave out --method"
        raise CommandError(message)
    try:
        found = replay_with(directory, method, given, session)
    except DecodeError as error:
        message = f"{directory}: a row cannot be read ({error}): `sfid verify {directory}` tells where"
        raise CommandError(message, NOT_SO) from None
    if not found:
        raise no_such_session(directory, session)
    misfits = [one for one in found if isinstance(one, Misfit)]
    replayed = [one for one in found if not isinstance(one, Misfit)]
    if not replayed:
        raise CommandError(_none_fits(misfits))
    if json:
        rows = [
            {"session": one.session, "decisions": one.decisions, "answers": one.answers,
             "recorded": asdict(one.recorded), "other": asdict(one.other)}
            for one in replayed
        ]  # fmt: skip
        print_json({
            "off_policy": True, "note": OFF_POLICY, "parameters": given, "sessions": rows,
            "misfits": [asdict(one) for one in misfits],
        })  # fmt: skip
        return
    print(OFF_POLICY)
    for one in replayed:
        print(f"{one.session}: {one.decisions} decisions, {one.answers} answers")
        for role, lesson in (("recorded", one.recorded), ("other", one.other)):
            solves = "" if lesson.success is None else f", alone solves {lesson.success:.0%} of all states"
            print(f"  {role} {lesson.method}: {lesson.states} states{solves}, q_sha256 {lesson.q_sha256}")
    for misfit in misfits:
        print(f"{misfit.session}: left out: {misfit.reason}")


def _none_fits(misfits: "list[Misfit]") -> str:
    """Return why not one session can be learnt from, each reason once with the sessions that it holds for."""
    sessions: dict[str, list[str]] = {}
    for one in misfits:
        sessions.setdefault(one.reason, []).append(one.session)
    return "; ".join(
        f"session{'s' if len(names) > 1 else ''} {', '.join(names)}: {reason}"
        for reason, names in sessions.items()
    )


def _row(one: Replayed) -> dict[str, object]:
    return {
        "session": one.session,
        "q_sha256": one.q_sha256,
        "matches": one.matches,
        "events": one.events,
    } | ({"erased": one.erased} if one.erased else {})


def _crowd_row(one: ReplayedCrowd) -> dict[str, object]:
    workers = [
        {"worker": worker, "reliability": known.mean, "standard_error": known.standard_error,
         "labels": known.labels, "standing": known.standing}
        for worker, known in one.reliabilities.items()
    ]  # fmt: skip
    return {
        "session": one.session, "aggregator": one.aggregator, "matches": one.matches,
        "conclusions": one.conclusions, "workers": workers,
    }  # fmt: skip


def verify(directory: DirectoryArgument, json: Json = False) -> None:
    """Check a journal: dense numbers, hash chain, mirror against database, unique answers."""
    found = verify_journal(directory)
    if json:
        print_json(
            {
                "ok": found.ok,
                "sessions": found.sessions,
                "labels": found.labels,
                "problems": list(found.problems),
            }
            | ({"erased": found.erased} if found.erased else {})
        )
    else:
        verdict = "ok" if found.ok else "NOT OK"
        counts = f"{_count(found.sessions, 'session')}, {_count(found.labels, 'label')}"
        erased = f" ({found.erased} of them erased)" if found.erased else ""
        print(f"{verdict}: {counts}{erased}, {_count(found.rows, 'row')}")
        for problem in found.problems:
            print(f"  {problem}")
    if not found.ok:
        raise typer.Exit(NOT_SO)
