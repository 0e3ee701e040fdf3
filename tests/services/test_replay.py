"""Rebuilding sessions from a journal, and noticing when what was noted does not come out again."""

from hashlib import sha256
from pathlib import Path

from protocol.codec import encode, pack
from protocol.journal import Kind
from protocol.messages import CreateSession, WindowSpec, World
from services.cli.shared.failure import NOT_SO
from services.replay import replay_directory
from services.runtime.journal import Shard
from sfid_core.sokoban.levels import packaged
from tests.services.cli.command_line import sfid

EMPTY = sha256().hexdigest()


def journal(data_dir: Path, *digests: str) -> None:
    """Write the journal of a session that has learnt nothing yet, with digests noted."""
    world = World(level=packaged("room")[0].to_xsb())
    config = CreateSession(session="s1", world=world, window=WindowSpec(mode="early", span_ms=1_000))
    with Shard.open(data_dir) as shard:
        shard.append("s1", Kind.CREATED.value, encode(config), at_ns=1)
        for digest in digests:
            shard.append("s1", Kind.DIGEST.value, pack([0, 0, digest]), at_ns=2)


def test_a_noted_digest_that_does_not_come_out_again_is_told(tmp_path: Path) -> None:
    journal(tmp_path, EMPTY, "0" * 64)
    (replayed,) = replay_directory(tmp_path)
    assert (replayed.q_sha256, replayed.matches, replayed.digests) == (EMPTY, False, 2)
    done = sfid("replay", str(tmp_path), "--verify")
    assert (done.code, "DIFFERS" in done.stdout) == (NOT_SO, True)


def test_digests_that_come_out_again_match(tmp_path: Path) -> None:
    journal(tmp_path, EMPTY)
    (replayed,) = replay_directory(tmp_path)
    assert (replayed.matches, replayed.digests) == (True, 1)
    done = sfid("replay", str(tmp_path), "--verify")
    assert (done.code, done.stdout) == (
        0,
        f"s1: 0 events, 0 episodes, q_sha256 {EMPTY}: matches 1 noted digest\n",
    )


def test_a_session_before_its_first_digest_is_no_fault(tmp_path: Path) -> None:
    journal(tmp_path)
    (replayed,) = replay_directory(tmp_path)
    assert (replayed.matches, replayed.digests) == (True, 0)
    done = sfid("replay", str(tmp_path), "--verify")
    assert (done.code, done.stdout) == (
        0,
        f"s1: 0 events, 0 episodes, q_sha256 {EMPTY}: nothing to compare yet\n",
    )


def test_one_of_a_kind_is_counted_in_the_singular(tmp_path: Path) -> None:
    journal(tmp_path)
    assert sfid("verify", str(tmp_path)).stdout == "ok: 1 session, 0 labels, 1 row\n"
