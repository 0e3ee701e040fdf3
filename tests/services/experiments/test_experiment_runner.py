"""Running conditions: results do not depend on the workers, and what was finished is not run again."""

import os
import shutil
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import sfid_core
from services.experiments.chunks import ChunkStore
from services.experiments.runner import RunnerConfig, run_conditions
from sfid_core.experiments.condition import SEEDS_AT_ONCE, Condition, results_sha256
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.sokoban.levels import packaged
from sfid_core.teaching.personas import persona_named

WORLD = WorldSpec(packaged("room")[0].to_xsb(), starts="all", steps_max=20)
SEEDS = range(SEEDS_AT_ONCE + 10)


def conditions(episodes: int = 4) -> list[Condition]:
    teachers = {"ann": persona_named("noisy")}
    return [
        Condition("ann", SessionConfig("lab", WORLD, method, episodes=episodes), teachers, checkpoints)
        for method, checkpoints in (("sfid-memory", ()), ("q-learning", (2, 4)))
    ]


def run(workers: int = 1, store: Path | None = None) -> tuple[str, list[tuple[int, int]]]:
    told: list[tuple[int, int]] = []
    config = RunnerConfig(workers, fast=False, store=store)
    results = run_conditions(conditions(), SEEDS, config, lambda done, of: told.append((done, of)))
    assert [one.shape for one in results] == [(60, 4, 10), (60, 2, 3)]
    return results_sha256(results), told


def test_the_results_do_not_depend_on_the_number_of_workers() -> None:
    assert run(1)[0] == run(3)[0]


def test_progress_counts_the_seeds_of_all_conditions() -> None:
    _, told = run(2)
    assert (told[0], told[-1], len(told)) == ((0, 120), (120, 120), 5)


def test_finished_chunks_are_taken_up_and_a_broken_one_is_run_again(tmp_path: Path) -> None:
    sha256, _ = run(store=tmp_path)
    assert run(store=tmp_path) == (sha256, [(120, 120)])
    chunks = sorted(tmp_path.glob("*.npy"))
    assert len(chunks) == 4
    chunks[0].write_bytes(chunks[0].read_bytes()[:50])
    chunks[1].unlink()
    again, told = run(store=tmp_path)
    assert again == sha256
    assert 0 < told[0][0] < 120
    assert run(store=tmp_path)[1] == [(120, 120)]


def test_chunks_of_another_condition_or_other_seeds_are_not_taken(tmp_path: Path) -> None:
    store, (first, second) = ChunkStore(tmp_path), conditions()
    kept = np.zeros((2, 4, 10))
    store.save(first, (1, 2), kept)
    found = store.load(first, (1, 2))
    assert found is not None
    assert np.array_equal(found, kept)
    assert store.load(first, (1, 3)) is None
    assert store.load(second, (1, 2)) is None
    assert store.load(conditions(episodes=5)[0], (1, 2)) is None


def test_a_chunk_with_a_flipped_bit_is_run_again(tmp_path: Path) -> None:
    store, (first, _) = ChunkStore(tmp_path), conditions()
    store.save(first, (1, 2), np.ones((2, 4, 10)))
    (kept,) = tmp_path.glob("*.npy")
    whole = kept.read_bytes()
    for place in (10, len(whole) // 2, len(whole) - 40, len(whole) - 1):
        damaged = bytearray(whole)
        damaged[place] ^= 1
        kept.write_bytes(damaged)
        assert store.load(first, (1, 2)) is None
    kept.write_bytes(b"")
    assert store.load(first, (1, 2)) is None


def kept_often(folder: Path) -> int:
    store, (first, _) = ChunkStore(folder), conditions()
    for _ in range(200):
        store.save(first, (1, 2), np.ones((2, 4, 10)))
    return os.getpid()


def test_two_experiments_at_once_may_keep_their_chunks_in_one_folder(tmp_path: Path) -> None:
    with ProcessPoolExecutor(2) as pool:
        list(pool.map(kept_often, [tmp_path] * 4))
    found = ChunkStore(tmp_path).load(conditions()[0], (1, 2))
    assert found is not None
    assert np.array_equal(found, np.ones((2, 4, 10)))
    assert len(list(tmp_path.iterdir())) == 1


LOOK = """
import sys
from pathlib import Path
from services.experiments.chunks import ChunkStore

class Any:
    digest = "the condition's"

print(ChunkStore(Path(sys.argv[1])).load(Any(), (1, 2)) is not None)
"""


def test_chunks_of_other_sources_are_not_taken(tmp_path: Path) -> None:
    copied, kept = tmp_path / "changed", tmp_path / "chunks"
    package = Path(sfid_core.__file__).parent
    shutil.copytree(package, copied / "sfid_core", ignore=shutil.ignore_patterns("__pycache__"))
    save = LOOK.replace(
        "print(", "import numpy\nChunkStore(Path(sys.argv[1])).save(Any(), (1, 2), numpy.ones(2))\nprint("
    )

    def told(script: str) -> str:
        paths = {"PYTHONPATH": os.pathsep.join((str(copied), str(package.parent)))}
        command = [sys.executable, "-c", script, str(kept)]
        run = subprocess.run(
            command, capture_output=True, text=True, check=True, cwd=copied, env=os.environ | paths
        )
        return run.stdout.strip()

    assert (told(save), told(LOOK)) == ("True", "True")
    with (copied / "sfid_core" / "outcome.py").open("a") as file:
        file.write("# changed\n")
    assert told(LOOK) == "False"


def test_a_fault_in_a_condition_ends_the_run_with_its_reason() -> None:
    config = SessionConfig("lab", WorldSpec("#####\n#@$ #\n# . #\n#####"), "sfid")
    hopeless = Condition("ann", config, {"ann": persona_named("oracle")})
    with pytest.raises(ValueError, match="solv"):
        run_conditions([hopeless], range(2), RunnerConfig(1, fast=False), lambda _done, _of: None)
