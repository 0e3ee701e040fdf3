"""Which shard a session belongs to, how many there are, and when one is free: pure, and files."""

from pathlib import Path
from random import Random

import pytest

from services.learner.config import LearnerConfig
from services.learner.ownership import agree_on_shards, shard_of
from services.learner.vigil import FAILED_MS, Vigil
from services.runtime.journal import JournalError, Shard

MS = 1_000_000


def test_the_shard_of_a_name_is_the_same_for_ever_and_that_of_its_branches() -> None:
    assert [shard_of(name, 3) for name in ("s1", "s2", "s3", "lesson", "study-p1")] == [0, 1, 2, 2, 2]
    for name in ("s1", "lesson", "a-b-c"):
        branches = (f"{name}-from3", f"{name}-from3-from1", f"{name}-from-the-middle")
        assert {shard_of(branch, 7) for branch in branches} == {shard_of(name, 7)}


def test_a_thousand_sessions_spread_evenly() -> None:
    counts = [0] * 8
    for number in range(1_000):
        counts[shard_of(f"session-{number}", 8)] += 1
    assert min(counts) > 90
    assert max(counts) < 160


def test_a_new_data_directory_is_held_to_the_first_number_of_shards(tmp_path: Path) -> None:
    agree_on_shards(tmp_path / "new", 3)
    agree_on_shards(tmp_path / "new", 3)
    assert (tmp_path / "new" / "shards").read_text() == "3 begun\n"
    for other in (1, 2, 4):
        with pytest.raises(
            JournalError, match=r"new: its sessions lie in 3 shards, not in .: pass --shards 3$"
        ):
            agree_on_shards(tmp_path / "new", other)


def test_a_directory_of_one_learner_stays_one_shard_and_gets_no_file(tmp_path: Path) -> None:
    agree_on_shards(tmp_path, 1)
    Shard.open(tmp_path).close()
    with pytest.raises(JournalError, match="lie in 1 shards, not in 3"):
        agree_on_shards(tmp_path, 3)
    agree_on_shards(tmp_path, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["shard-0"]


@pytest.mark.parametrize("text", ["", "many", "0", "99999", "\xff"])
def test_a_damaged_count_is_told_with_its_mend(tmp_path: Path, text: str) -> None:
    (tmp_path / "shards").write_text(text, encoding="latin-1")
    with pytest.raises(JournalError, match="shards: not a number of shards: write the number"):
        agree_on_shards(tmp_path, 3)


def vigil(*, home: int | None = 0, shards: int = 3, seed: int = 1) -> Vigil:
    config = LearnerConfig(Path(), shards=shards, takeover_ms=2_000, settle_ms=5_000, jitter_ms=0)
    return Vigil(config, home, 0, Random(seed))


def test_the_home_shard_is_free_at_once_and_the_others_once_their_learners_had_time_to_come() -> None:
    watch = vigil()
    assert watch.due(0) == 0
    watch.took(0)
    assert watch.due(5_249 * MS) is None
    assert watch.due(5_250 * MS) == 1
    watch.took(1)
    assert watch.due(5_499 * MS) is None
    assert watch.due(5_500 * MS) == 2


def test_a_shard_whose_learner_is_there_is_left_alone_until_it_has_been_gone_for_a_while() -> None:
    watch = vigil(home=None)
    for shard in range(3):
        watch.came(shard)
    assert watch.due(60_000 * MS) is None
    watch.went(1, 60_000 * MS)
    assert watch.due(61_999 * MS) is None
    watch.came(1)
    assert watch.due(70_000 * MS) is None
    watch.went(1, 80_000 * MS)
    assert watch.due(82_000 * MS) == 1


def test_who_has_more_shards_waits_longer_so_that_those_of_the_dead_spread() -> None:
    held: dict[str, set[int]] = {"a": set(), "b": set()}
    config = LearnerConfig(Path(), shards=8, jitter_ms=50)
    watches = {name: Vigil(config, None, 0, Random(name)) for name in held}
    for ms in range(0, 20_000, 20):
        for name, watch in watches.items():
            shard = watch.due(ms * MS)
            if shard is not None:
                watch.took(shard)
                held[name].add(shard)
                for other in watches.values():
                    other.came(shard)
    assert (len(held["a"]), len(held["b"])) == (4, 4)
    assert held["a"] | held["b"] == set(range(8))


def test_a_lost_shard_is_stood_by_for_and_one_that_failed_rests_longer() -> None:
    watch = vigil(home=1)
    watch.took(1)
    watch.lost(1, 10_000 * MS)
    assert watch.due(11_999 * MS) in {0, 2}
    for shard in (0, 2):
        watch.took(shard)
    assert watch.due(12_499 * MS) is None
    assert watch.due(12_500 * MS) == 1
    watch.lost(1, 20_000 * MS, failed=True)
    assert watch.due((20_000 + FAILED_MS + 499) * MS) is None
    assert watch.due((20_000 + FAILED_MS + 500) * MS) == 1


def test_a_lost_shard_that_another_has_is_not_free() -> None:
    watch = vigil(home=1)
    watch.took(1)
    watch.came(1)
    watch.lost(1, 0)
    for shard in (0, 2):
        watch.came(shard)
    assert watch.due(60_000 * MS) is None


def test_who_was_cut_off_gives_the_others_a_moment_to_be_seen_again() -> None:
    watch = vigil(home=None)
    for shard in range(3):
        watch.went(shard, 0)
    watch.reconnected(30_000 * MS)
    assert watch.due(31_999 * MS) is None
    for shard in (0, 2):
        watch.came(shard)
    assert watch.due(32_000 * MS) == 1
