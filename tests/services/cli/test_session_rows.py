"""`sfid session list`: by name, as many as were asked for, with a count below; who else needs it whole."""

import json

import msgspec
import pytest

from protocol.codec import encode
from protocol.keys import Keys
from protocol.messages import Done, GymWorld, SessionList, SessionSummary, WindowSpec
from services.cli.demo import named_afresh
from services.cli.session import session_config
from services.cli.session_rows import State, counted, lacking, listed, state_of
from services.cli.shared.failure import CommandError
from services.operator import Operator
from services.router import RouterConfig, free_endpoint
from services.runtime.memory_bus import MemoryBus, MemoryHub
from services.runtime.zenoh_bus import open_bus
from sfid_core.session.state import Phase
from tests.protocol.samples import CREATE, SUMMARY
from tests.services.cli.command_line import sfid
from tests.services.linked import routing


def row(name: str, phase: str = "asking", *, paused: bool = False) -> SessionSummary:
    return msgspec.structs.replace(SUMMARY, session=name, phase=phase, paused=paused)


ROWS = [row("maze-b"), row("room", "finished"), row("maze-a", paused=True), row("cave")]


def test_sessions_are_listed_by_name_however_the_learners_answer() -> None:
    names = ["cave", "maze-a", "maze-b", "room"]
    assert [one.session for one in listed(ROWS, None, None)] == names
    assert [one.session for one in listed(ROWS[::-1], None, None)] == names


def test_a_text_of_the_name_and_a_state_choose_sessions() -> None:
    assert [one.session for one in listed(ROWS, "maze", None)] == ["maze-a", "maze-b"]
    assert [one.session for one in listed(ROWS, None, State.PAUSED)] == ["maze-a"]
    assert [one.session for one in listed(ROWS, "maze", State.ASKING)] == ["maze-b"]
    assert listed(ROWS, "nowhere", None) == []


def test_the_line_below_counts_all_and_those_that_were_asked_for() -> None:
    assert counted(ROWS, 4) == "4 sessions: 2 asking, 1 paused, 1 finished"
    assert counted(listed(ROWS, "maze", None), 4) == "2 of 4 sessions: 1 asking, 1 paused"
    assert counted([], 4) == "0 of 4 sessions"
    assert counted(ROWS[:1], 1) == "1 session: 1 asking"


def test_every_state_a_session_can_have_can_be_asked_for() -> None:
    assert {one.value for one in State} == {one.value for one in Phase} | {"paused"}
    assert state_of(row("s1", "asking", paused=True)) == "paused"


@pytest.mark.parametrize(
    "shards,told,line",
    [
        (1, (0,), None),
        (3, (0, 1, 2), None),
        (1, (), "the list is not whole: shard-0 of 1 shard did not answer to the end; "),
        (3, (0, 1), "the list is not whole: shard-2 of 3 shards did not answer to the end; "),
        (4, (2,), "the list is not whole: shard-0, shard-1, shard-3 of 4 shards did not answer to the end; "),
        (64, (), "shard-6, shard-7 and 56 more of 64 shards did not answer to the end; "),
    ],
)
def test_shards_that_did_not_tell_all_are_named_in_one_line_with_the_mend(
    shards: int, told: tuple[int, ...], line: str | None
) -> None:
    said = lacking(SessionList(sessions=(), shards=shards, told=told), "`sfid status`")
    if line is None:
        assert said is None
    else:
        assert said is not None
        assert line in said
        assert said.endswith(
            "`sfid status` tells how each does: start the absent learner, or end the one that hangs"
        )
        assert "\n" not in said


@pytest.mark.real
def test_the_command_lists_what_learners_tell() -> None:
    at = free_endpoint()
    with routing(RouterConfig(at)):
        learner = open_bus(at, 5_000)
        told = [SessionList(sessions=tuple(ROWS))]
        learner.serve(
            Keys("local").learner("list"), lambda request: request.reply(encode(told[-1])), shared=True
        )
        whole = sfid("session", "list", "--connect", at)
        told.append(SessionList(sessions=tuple(ROWS), shards=3, told=(0, 2)))
        mazes = sfid("session", "list", "--connect", at, "--match", "maze", "--state", "paused", "--json")
        told.append(SessionList(sessions=(), shards=3, told=(0, 2)))
        nothing = sfid("session", "list", "--connect", at)
        learner.close()
    lines = whole.stdout.splitlines()
    assert [line.partition(":")[0] for line in lines[:-1]] == ["cave", "maze-a", "maze-b", "room"]
    assert lines[-1] == "4 sessions: 2 asking, 1 paused, 1 finished"
    assert [one["session"] for one in json.loads(mazes.stdout)] == ["maze-a"]
    line = lacking(told[1], f"`sfid status --connect {at}`")
    assert line is not None
    assert [line in one.stderr.splitlines() for one in (whole, mazes, nothing)] == [False, True, True]
    assert nothing.stdout == "0 sessions\n"
    assert [one.code for one in (whole, mazes, nothing)] == [0, 0, 0]


@pytest.mark.real
def test_a_session_is_called_created_only_where_all_learners_told_what_there_was() -> None:
    at = free_endpoint()
    whole, partial = (SessionList(sessions=tuple(ROWS), shards=3, told=told) for told in ((0, 1, 2), (0, 2)))
    told: list[SessionList] = []
    with routing(RouterConfig(at)):
        learner, keys = open_bus(at, 5_000), Keys("local")
        learner.serve(keys.learner("list"), lambda request: request.reply(encode(told[-1])), shared=True)
        learner.serve(
            keys.learner("create"), lambda request: request.reply(encode(Done(ok=True))), shared=True
        )
        done = []
        for name, before in (("new", whole), ("new", partial), ("cave", partial)):
            told.append(before)
            done.append(sfid("session", "create", name, "--connect", at))
        learner.close()
    assert [one.code for one in done] == [0, 0, 0]
    assert [one.stdout.partition(": ")[0] for one in done] == [
        "session new created",
        "session new created, or was there already, just so",
        "session cave was there already, just so",
    ]
    line = lacking(partial, f"`sfid status --connect {at}`")
    assert line is not None
    assert [line in one.stderr.splitlines() for one in done] == [False, True, False]


class Lists(Operator):
    """An operator who was told one list."""

    def __init__(self, told: SessionList) -> None:
        super().__init__(MemoryBus(MemoryHub()), Keys("demo"))
        self._told = told

    def sessions(self) -> SessionList:
        return self._told


def test_a_demo_takes_no_name_that_may_be_taken() -> None:
    wanted = msgspec.structs.replace(CREATE, session="cave")
    assert named_afresh(Lists(SessionList(sessions=tuple(ROWS))), wanted).session == "cave-2"
    with pytest.raises(
        CommandError, match=r"^cave: what sessions there are was not told to the end, .*--data"
    ):
        named_afresh(Lists(SessionList(sessions=tuple(ROWS), told=())), wanted)


@pytest.mark.parametrize("parameters,advised", [(None, []), ({}, ["-p omega=penalty"])])
def test_a_command_without_a_flag_for_parameters_advises_none(
    parameters: dict[str, float | str] | None, advised: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    lake = GymWorld(
        environment="FrozenLake-v1", actions=("LEFT", "RIGHT"), level_name="lake", goal_reward=1.0
    )
    window = WindowSpec(mode="early", span_ms=1_000)
    session_config("demo", "", "sfid", 3, "4", 0, window, 1, parameters, lake)
    told = capsys.readouterr().err
    assert "use `--reward-scale 9` or more" in told
    assert [flag for flag in ("-p omega=penalty", "a goal reward of") if flag in told] == advised
