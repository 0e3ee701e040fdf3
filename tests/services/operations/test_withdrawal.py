"""Withdrawal: tokens are worthless at once, and no file of the deployment keeps a byte of the person."""

import json
import zlib
from pathlib import Path

import pytest

from protocol.identity import Identity, Role, sign
from services.operations.forget import forget
from services.operations.withdrawal import revoke_person
from services.replay import replay_directory
from services.runtime.clock import ManualClock, SystemClock
from services.runtime.doorkeeper import DoorFault, Doorkeeper
from services.runtime.journal import JournalLocked, Shard, verify
from services.runtime.register import Register, given_for, new_token_id
from services.runtime.secret import load_secrets
from tests.services.cli.command_line import sfid
from tests.services.operations.test_forget import OTHER, PERSON, holding, payloads, taught

DAY_S = 24 * 3600
S = 1_000_000_000


class House:
    """A deployment that gives tokens out, and a service of it that verifies them."""

    def __init__(self, data: Path) -> None:
        self.data = data
        self.clock = ManualClock(wall_ns=SystemClock().wall_ns())
        self.secrets = load_secrets(data / "gateway")
        self.door = Doorkeeper(data, self.clock.wall_ns)

    def token(self, name: str, session: str = "s1", invitation: str = "") -> str:
        identity = Identity(
            role=Role.TEACHER, session=session, pseudonym=name, token_id=new_token_id(),
            expires_s=self.clock.wall_ns() // S + DAY_S, invitation=invitation,
        )  # fmt: skip
        return sign(identity, self.secrets)

    def fault(self, name: str, token: str, session: str = "s1") -> DoorFault | None:
        self.clock.advance(S)
        return self.door.fault(session, name, token)


def test_a_running_service_refuses_the_tokens_of_whoever_withdrew_and_of_nobody_else(tmp_path: Path) -> None:
    house = House(tmp_path)
    theirs, others = house.token(PERSON), house.token(OTHER)
    assert (house.fault(PERSON, theirs), house.fault(OTHER, others)) == (None, None)
    assert revoke_person(tmp_path, PERSON)
    assert (house.fault(PERSON, theirs), house.fault(OTHER, others)) == (DoorFault.REVOKED, None)
    assert house.fault(PERSON, house.token(PERSON)) is DoorFault.REVOKED, "a new one for the same name too"
    assert holding(tmp_path, PERSON.encode()) == []


def test_from_one_session_only_the_token_for_that_one_goes(tmp_path: Path) -> None:
    house = House(tmp_path)
    assert revoke_person(tmp_path, PERSON, "s1")
    assert house.fault(PERSON, house.token(PERSON)) is DoorFault.REVOKED
    assert house.fault(PERSON, house.token(PERSON, "s2"), "s2") is None


def test_where_nobody_was_given_a_token_there_is_nothing_to_revoke(tmp_path: Path) -> None:
    assert not revoke_person(tmp_path, PERSON)
    assert list(tmp_path.iterdir()) == []


def test_a_withdrawal_holds_after_another_secret_was_added(tmp_path: Path) -> None:
    house = House(tmp_path)
    revoke_person(tmp_path, PERSON)
    with (tmp_path / "gateway" / "secret").open("a") as file:
        file.write("cd" * 32 + "\n")
    later = House(tmp_path)
    assert later.fault(PERSON, later.token(PERSON)) is DoorFault.REVOKED
    assert later.fault(OTHER, house.token(OTHER)) is None


def test_a_running_learner_keeps_the_rows_but_the_withdrawal_takes_effect_at_once(tmp_path: Path) -> None:
    data = taught(tmp_path / "data")
    house = House(data)
    token = house.token(PERSON)
    with Shard.open(data), pytest.raises(JournalLocked):
        forget(data, PERSON, SystemClock())
    assert house.fault(PERSON, token) is DoorFault.REVOKED


def test_a_service_that_has_read_the_register_reads_on_after_it_was_written_anew(tmp_path: Path) -> None:
    data = taught(tmp_path / "data")
    house = House(data)
    register = Register(data / "gateway")
    invitation = Identity(
        role=Role.INVITATION, session="s1", expires_s=2**40, token_id=new_token_id(), people=9
    )
    names = [register.take_up(invitation, f"nonce-{number}") for number in range(3)]
    own = given_for(invitation, names[0], house.secrets)[1]
    forget(data, names[0], SystemClock())
    assert holding(data, names[0].encode()) == []
    assert register.take_up(invitation, "nonce-1") == names[1]
    register.revoke(new_token_id())
    assert house.fault(names[0], own) is DoorFault.REVOKED


def test_not_one_byte_is_left_in_any_file_after_the_command(tmp_path: Path) -> None:
    data = taught(tmp_path / "data")
    theirs = payloads(data, PERSON)
    house = House(data)
    own = house.token(PERSON)
    files = {
        "recordings/s1.rrd": b"RRF2" + PERSON.encode(),
        "exports/answers.csv": f"teacher,action\n{PERSON},UP\n".encode(),
        "exports/other.csv": b"teacher,action\nann,UP\n",
        "exports/answers.parquet": b"PAR1" + zlib.compress(PERSON.encode()),
        "logs/learner.log": json.dumps({"message": "gone", "teacher": PERSON}).encode() + b"\n",
        "shard-0/journal.sqlite.damaged-1": b"SQLite" + PERSON.encode(),
        "study-maze/people.json": json.dumps({PERSON: {"recruiter": "abc"}, "ann": {}}).encode(),
        "gateway/register.jsonl": json.dumps(
            {"event": "taken-up", "token": "0" * 16, "nonce": "ab", "pseudonym": PERSON}
        ).encode()
        + b"\n",
    }
    with Shard.open(data / "study-maze") as shard:
        shard.append("maze", "consented", PERSON.encode(), at_ns=1, person=PERSON)
    for name, content in files.items():
        (data / name).parent.mkdir(exist_ok=True)
        (data / name).write_bytes(content)
    done = sfid("forget", str(data), "--person", PERSON, "--json")
    assert done.code == 0, done.stderr
    (told,) = json.loads(done.stdout)["people"]
    assert (told["tokens_revoked"], told["left"], told["recordings_removed"]) == (True, [], True)
    assert holding(data, PERSON.encode(), *theirs) == []
    left = {path.relative_to(data).as_posix() for path in data.rglob("*") if path.is_file()}
    assert set(files) - left == {
        "recordings/s1.rrd", "exports/answers.csv", "exports/answers.parquet",
        "shard-0/journal.sqlite.damaged-1",
    }  # fmt: skip
    assert house.fault(PERSON, own) is DoorFault.REVOKED
    (replayed,) = replay_directory(data)
    assert (replayed.matches, replayed.q_sha256, verify(data).ok) == (
        True, told["sessions"][0]["q_sha256"], True,
    )  # fmt: skip
