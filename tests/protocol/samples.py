"""One full and one spare example of every message, for vectors, round trips and hostile bytes."""

from protocol.crowd_message import Crowd, WorkerReliability
from protocol.messages import (
    Acknowledgement,
    Answer,
    Branch,
    Control,
    CreateSession,
    Decision,
    Done,
    Episode,
    GymWorld,
    Join,
    JournalRow,
    JournalRows,
    LabelTotals,
    MistakeMark,
    Refusal,
    RowsQuery,
    SaidBy,
    SessionList,
    SessionQuery,
    SessionReport,
    SessionSummary,
    Step,
    Welcome,
    WindowSpec,
    Wire,
    World,
)
from protocol.world_messages import Begin, Begun, ExecuteAction, Executed

VIEW = "#####\n#@$.#\n#####"
STATE = bytes(range(16))
NEXT_STATE = bytes(range(16, 32))
ANSWER_ID = bytes(range(0xA0, 0xB0))
TOKEN = "signed.token"  # noqa: S105 - an example, signed by nobody
ACTIONS = ("LEFT", "RIGHT", "UP", "DOWN")
WINDOW = WindowSpec(mode="early", span_ms=2000, quorum=0)
WORLD = World(level=VIEW, level_name="corridor", starts="1")
LAKE = GymWorld(
    environment="FrozenLake-v1",
    options={"is_slippery": False, "map_name": "4x4", "success_rate": 1.0},
    actions=("LEFT", "DOWN", "RIGHT", "UP"),
    level_name="FrozenLake-v1 (is_slippery=False)",
    starts="4",
    render="text",
    reward_scale=10.0,
    goal_reward=10.0,
    step_reward=0.0,
    steps_max=100,
)

DECISION = Decision(
    session="s1",
    epoch=1,
    sequence=12,
    decision=5,
    episode=1,
    step=2,
    phase="asking",
    paused=False,
    asked="label",
    state=STATE,
    view=VIEW,
    actions=ACTIONS,
    remaining_ms=1500,
    window=WINDOW,
    teachers=("ann", "bob"),
    teachers_present=2,
    method="sfid",
    episodes=30,
    optimal_steps=1,
)
STEP = Step(
    session="s1",
    epoch=1,
    decision=5,
    episode=1,
    step=2,
    at_ns=1_700_000_000_000_000_000,
    state=STATE,
    view=VIEW,
    action="RIGHT",
    said=(SaidBy(teacher="ann", kind="label", action="RIGHT"), SaidBy(teacher="bob", kind="abstain")),
    label="RIGHT",
    h=1.0,
    reward=10.0,
    td_error=10.0,
    td_error_shaped=11.0,
    outcome="solved",
    next_view="#####\n# @*#\n#####",
    values=(0.0, 1.1, -0.1, 0.0),
)
EPISODE = Episode(
    session="s1",
    epoch=1,
    decision=6,
    at_ns=1_700_000_000_000_000_000,
    episode=1,
    steps=3,
    optimal_steps=1,
    abs_td_error=3.5,
    abs_td_error_shaped=4.25,
    discounted_return=9.5,
    discounted_env_return=8.1,
    inputs=3,
    agreements=2,
    outcome="solved",
)
CREATE = CreateSession(
    session="s1",
    world=WORLD,
    parameters={"alpha": 0.2, "omega": "centred"},
    window=WINDOW,
    seed=42,
)
SUMMARY = SessionSummary(
    session="s1",
    method="sfid",
    level_name="corridor",
    phase="asking",
    paused=False,
    episode=1,
    episodes=30,
    decision=5,
    teachers=("ann", "bob"),
)
TOTALS = LabelTotals(submitted=9, acknowledged=8, applied=5, superseded=1, late=1, rejected=1, pending=1)

LABEL = Answer(
    answer_id=ANSWER_ID,
    session="s1",
    teacher="ann",
    epoch=1,
    decision=5,
    episode=1,
    step=2,
    state=STATE,
    kind="label",
    action="UP",
)
"""The plainest answer there is."""

FULL: tuple[Wire, ...] = (
    DECISION,
    STEP,
    EPISODE,
    Crowd(
        session="s1",
        aggregator="crowd",
        epoch=1,
        decision=5,
        at_ns=1_700_000_000_000_000_000,
        cause="quorum",
        members=2,
        answered=2,
        action="RIGHT",
        posterior={"LEFT": 0.125, "RIGHT": 0.875},
        conclusions=6,
        too_late=1,
        workers=(
            WorkerReliability(
                worker="ann", mean=0.75, standard_error=0.0625, labels=6, standing="good", present=True
            ),
        ),
    ),
    Join(session="s1", teacher="ann", client="example 1.0", token=TOKEN),
    Welcome(
        session="s1",
        epoch=1,
        rights=("answer", "window", "pause"),
        decision=DECISION,
        episodes=(EPISODE,),
        check_key=bytes(range(32)),
    ),
    Answer(
        answer_id=ANSWER_ID,
        session="s1",
        teacher="ann",
        epoch=1,
        decision=5,
        episode=1,
        step=2,
        state=STATE,
        kind="label",
        action="RIGHT",
        reward=-0.5,
        guidance=("UP", "RIGHT"),
        mistake=MistakeMark(first_step=0, last_step=2),
        posterior={"LEFT": 0.125, "RIGHT": 0.875},
        response_ms=640,
        token=TOKEN,
    ),
    Acknowledgement(
        answer_id=ANSWER_ID,
        code="accepted",
        reason="",
        check=bytes.fromhex("0102030405060708"),
        epoch=1,
        journal_seq=77,
    ),
    Control(session="s1", teacher="ann", verb="window", window=WINDOW, token=TOKEN),
    Done(ok=False, reason="already paused or finished"),
    Refusal(code="busy", reason="the learner's inbox is full: send it again"),
    CREATE,
    Branch(session="s1", episode=4, branch="s1-from4"),
    SessionQuery(session="s1", first_episode=100, leave_out=9),
    SUMMARY,
    SessionList(sessions=(SUMMARY,), older=12, shards=3, told=(0, 2)),
    SessionReport(
        summary=SUMMARY,
        config=CREATE,
        epoch=1,
        labels=TOTALS,
        teaching_ns=12_000_000_000,
        q_sha256="00" * 32,
        malformed={"ann": 3},
        failure="the level cannot be solved from its own start",
        first_episode=0,
        episodes=(EPISODE,),
    ),
    RowsQuery(session="s1", after_seq=76),
    JournalRows(
        session="s1",
        rows=(JournalRow(seq=77, kind="paused", at_ns=1_790_000_000_000_000_000, body=b"\xa3ann"),),
        after_seq=77,
        whole=True,
    ),
    Begin(session="s1", epoch=1, episode=1, seed=42, world=WORLD, actions=("LEFT", "RIGHT")),
    Begun(episode=1, step=2, state=STATE, view=VIEW, optimal_steps=1, actions=ACTIONS),
    ExecuteAction(session="s1", epoch=1, decision=5, episode=1, step=2, state=STATE, action="RIGHT"),
    Executed(
        decision=5,
        reward=10.0,
        outcome="solved",
        state=NEXT_STATE,
        view="#####\n# @*#\n#####",
        optimal_steps=0,
    ),
)
"""Every message once, with every field that it can carry."""

OTHER_WORLDS: dict[str, Wire] = {
    "begin-gym": Begin(session="lake", epoch=1, episode=1, seed=42, world=LAKE, actions=("DOWN", "RIGHT")),
    "create-session-gym": CreateSession(session="lake", world=LAKE, window=WINDOW),
}
"""Messages whose world is of another kind, by the name of their vector."""
