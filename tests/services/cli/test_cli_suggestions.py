"""What a command says beside its result: what to type next, what there is, what it left out."""

import json
from pathlib import Path

import pytest

from services.cli.experiment.session import absent_teachers, replacement_note
from services.cli.session_source import condition_named
from services.cli.shared import launch
from services.cli.shared.launch import Deployed
from services.cli.shared.next_command import suggested, teaching
from services.cli.shared.options import DATA, ENDPOINT
from services.cli.shared.whereabouts import note_whereabouts
from services.cli.up import told
from services.monitor.config import TEACH
from tests.services.aggregator.crowd_room import CrowdRoom
from tests.services.cli.command_line import Done, sfid
from tests.services.learner.classroom import Classroom, Pupil, session

ELSEWHERE = "tcp/127.0.0.1:17447"


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    """Three sessions: s1 was taught a label by ann, s2 is judged and s3 waits for anybody."""
    room = Classroom(tmp_path / "data")
    room.create()
    ann = Pupil(room, "ann")
    ann.join()
    room.settle()
    ann.label(room.decision, "LEFT")
    room.create(session(session="s2", method="reward"))
    room.create(session(session="s3"))
    room.shard.commit()
    room.shard.close()
    return tmp_path / "data"


def test_a_suggested_command_has_the_flags_that_are_not_at_their_defaults() -> None:
    assert suggested("session list") == "`sfid session list`"
    assert suggested("session list", ENDPOINT, "local", data=DATA) == "`sfid session list`"
    assert (
        suggested("study status s.toml", data=Path("d"), usual_data=Path("d")) == "`sfid study status s.toml`"
    )
    assert suggested("session list", "tcp/0.0.0.0:7001", "lab", Path("my logins"), data=Path("/d")) == (
        "`sfid session list --connect tcp/127.0.0.1:7001 --deployment lab --access 'my logins' --data /d`"
    )


def test_viewers_are_told_commands_that_reach_the_session_wherever_it_runs() -> None:
    keyboard = "sfid teach keyboard --session {session}"
    assert teaching(ENDPOINT, "local", crowd=False) == f"`{keyboard}`" == TEACH
    assert teaching("tcp/0.0.0.0:7001", "lab", crowd=False) == (
        f"`{keyboard} --connect tcp/127.0.0.1:7001 --deployment lab`"
    )
    assert teaching(ENDPOINT, "local", crowd=True) == (
        f"`{keyboard}`, or as one of the crowd: `{keyboard} --deployment local-crowd`"
    )


def test_the_monitor_is_told_of_the_crowd_where_there_is_one() -> None:
    deployed = Deployed(DATA, ENDPOINT, "local")
    alone = launch.monitor(deployed, viewer=True, ports=(0, 0, 0)).arguments
    assert launch.monitor(deployed, viewer=True, ports=(0, 0, 0), crowd=True).arguments == (*alone, "--crowd")


def test_up_tells_commands_that_reach_its_own_router() -> None:
    details = {"router": ELSEWHERE, "monitor": "watch at http://x", "gateway": "http://y"}
    assert told(Deployed(DATA, ENDPOINT, "local"), {}, crowd=False) == [
        f"router at {ENDPOINT}, data in {DATA}",
        "next: `sfid session create NAME`, then `sfid teach keyboard --session NAME`",
    ]
    assert told(Deployed(Path("d"), ELSEWHERE, "local"), details, crowd=True) == [
        f"router at {ELSEWHERE}, data in d",
        "watch at http://x",
        "http://y",
        (
            "members of the crowd teach with "
            f"`sfid teach keyboard --session NAME --connect {ELSEWHERE} --deployment local-crowd`"
        ),
        (
            f"next: `sfid session create NAME --connect {ELSEWHERE}`, "
            f"then `sfid teach keyboard --session NAME --connect {ELSEWHERE}`"
        ),
    ]
    guarded = told(Deployed(Path("d"), ENDPOINT, "local", require_tokens=True), {}, crowd=False)
    assert guarded[-1] == (
        "next: `sfid session create NAME`, then `sfid keys new PERSON --session NAME --data d`, "
        "whose file goes to `sfid teach keyboard --session NAME --token-file FILE`"
    )


@pytest.mark.parametrize("command", [["replay"], ["replay", "--method", "clone"], ["said"]])
def test_a_session_that_is_not_there_is_refused_with_those_that_are(
    journal: Path, command: list[str]
) -> None:
    done = sfid(*command, str(journal), "--session", "s9")
    said = f"sfid: {journal}: no session s9: choose one with --session: s1, s2, s3\n"
    assert done == Done(1 if command == ["said"] else 2, "", said)


def test_a_session_in_which_nobody_spoke_is_told_from_one_that_is_not_there(journal: Path) -> None:
    done = sfid("said", str(journal), "--session", "s3")
    said = f"sfid: {journal}: nobody has said anything in session s3 yet: `sfid teach` teaches it\n"
    assert done == Done(1, "", said)


INVITE = ("invite", "--session", "s9", "--no-qr", "--data")


def test_who_invites_to_a_session_that_is_not_there_is_told_how_its_router_creates_it(journal: Path) -> None:
    note_whereabouts(journal, "tls/192.0.2.7:7447", "lab-crowd")
    create = "sfid session create s9 --connect tls/192.0.2.7:7447 --deployment lab"
    done = sfid(*INVITE, str(journal), "--url", "https://teach.example")
    assert done.code == 0
    assert done.stderr == (
        f"no session s9 in {journal} yet: whoever follows the link waits until there is one "
        f"(`{create}` creates it)\n"
    )


def test_who_invites_where_no_learner_keeps_its_sessions_is_told_that_the_name_is_not_checked(
    tmp_path: Path,
) -> None:
    done = sfid(*INVITE, str(tmp_path), "--url", "https://teach.example")
    said = f"cannot see the learner's sessions in {tmp_path}, so the name s9 is not checked\n"
    assert (done.code, done.stderr) == (0, said)
    assert done.stdout.startswith("https://teach.example/#t=")


def test_who_invites_people_elsewhere_to_a_page_of_this_machine_is_told(tmp_path: Path) -> None:
    status = tmp_path / "gateway" / "status.json"
    status.parent.mkdir()
    status.write_text(json.dumps({"url": "http://127.0.0.1:7480"}))
    far, page = ("--connect", "tls/192.0.2.7:7447"), "http://127.0.0.1:7480"
    only = f"{page} opens on its own machine only: where people have another address for it, pass --url"
    assert sfid(*INVITE, str(tmp_path), *far).stderr.splitlines()[1:] == [only]
    assert sfid(*INVITE, str(tmp_path), *far, "--url", page).stderr.count("\n") == 1
    assert sfid(*INVITE, str(tmp_path)).stderr.count("\n") == 1


class OneDirectory(CrowdRoom):
    """A crowd's room whose aggregator keeps its journal beside the learner's, as a deployment has it."""

    def start_learner(self) -> None:
        self.crowd_dir = self.data_dir
        super().start_learner()


def test_what_a_crowd_said_stands_by_decision_beside_what_came_of_it(tmp_path: Path) -> None:
    room = OneDirectory(tmp_path / "data")
    room.create()
    members = room.members("ann", "bea")
    for action in ("UP", "DOWN"):
        for member in members:
            member.label(action)
        room.settle()
    room.close()
    said = json.loads(sfid("said", str(tmp_path / "data"), "--session", "s1", "--json").stdout)["said"]
    assert [(one["decision"], one["teacher"], one["via"], one["action"]) for one in said] == [
        (decision, teacher, "" if teacher == "crowd" else "crowd", action)
        for decision, action in enumerate(("UP", "DOWN"))
        for teacher in ("ann", "bea", "crowd")
    ]
    lines = sfid("said", str(tmp_path / "data"), "--session", "s1").stdout.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["decision 0"] * 3 + ["decision 1"] * 3


def test_another_method_is_replayed_where_it_fits_and_names_where_it_does_not(journal: Path) -> None:
    document = json.loads(sfid("replay", str(journal), "--method", "clone", "--json").stdout)
    assert [one["session"] for one in document["sessions"]] == ["s1", "s3"]
    assert [one["session"] for one in document["misfits"]] == ["s2"]
    done = sfid("replay", str(journal), "--method", "marks")
    assert (done.code, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith("sfid: sessions s1, s3: method marks asks for mistake, the session's sfid")
    assert "; session s2: method marks asks for mistake, the session's reward" in done.stderr


def test_an_experiment_from_a_session_says_whose_teaching_it_replaces(journal: Path) -> None:
    order = ("experiment", "session", "--from", str(journal), "--session", "s1", "--seeds", "2",
             "--episodes", "1", "--no-compile", "--json")  # fmt: skip
    done = sfid(*order)
    assert done.stderr.splitlines()[0] == (
        "note: ann taught the recorded session and cannot be simulated by name: here expert teaches; "
        "choose with --teacher"
    )
    assert json.loads(done.stdout)["teachers"] == {"simulated": ["expert"], "absent": ["ann"]}
    assert absent_teachers(("oracle", "crowd", "ann"), ["oracle"]) == ("crowd", "ann")


def test_who_names_the_teachers_of_an_experiment_needs_no_note() -> None:
    condition = condition_named("figure2:sfid+naive")
    assert replacement_note(["ann", "crowd"], condition, None) == (
        "note: ann, crowd taught the recorded session and cannot be simulated by name: here naive teaches; "
        "choose with --teacher"
    )
    assert replacement_note(["ann"], condition, "naive") == replacement_note([], condition, None) == ""


def test_the_first_labels_are_shown_and_how_to_get_all(tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    rows = [f"t{task:02},{worker},yes\n" for task in range(12) for worker in ("ann", "bob")]
    path.write_text("".join(["task,worker,label\n", *rows]))
    lines = sfid("crowd", "aggregate", str(path), "--method", "majority").stdout.splitlines()
    begins = lines.index("labels:") + 1
    assert [line.split() for line in lines[begins:-1]] == [[f"t{task:02}", "yes"] for task in range(10)]
    assert lines[-1] == "  and 2 more: --out FILE.csv writes all, --json prints them"
