"""The faults of this directory as data: promise, test, share in CI, full number, and what carries it out.

    python -m tests.services.faults.campaigns [NAME ...]     the full numbers; results go to `results/`
    python -m tests.services.faults.table                    RELIABILITY.md from `results/`

The tests run the same functions with the share of CI.
"""

import argparse
import json
import logging
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

from services.simulate.campaign import campaign
from tests.services.faults import damage, fuzz, kills, power, restart

RESULTS = Path(__file__).with_name("results")
TESTS = "tests/services/faults/test_faults.py"
SEED = 1
SECONDS_MAX = 10.0
"""For the proof of a million labels."""
BACK_SECONDS_MAX = 3.0
"""Both of processor time: what a quiet machine takes."""
MEMORY_MB_MAX = 32
MEMORY = "/dev/shm"  # noqa: S108 - files in memory where there are such
IN_MEMORY = frozenset({"power-cuts", "bit-flips", "cuts"})
DECISIONS = 200
PROCESSES = 2
"""That share the simulator's seeds; what comes out does not depend on it."""


class Outcome(NamedTuple):
    """What a campaign came to."""

    tried: int
    result: str
    broken: tuple[str, ...]
    """What is not as promised; empty when the promise holds."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: what is promised, how often it is tried, and how."""

    name: str
    fault: str
    promise: str
    test: str
    share: int
    """How often in CI."""
    full: int
    run: Callable[[int, Path], Outcome]


@dataclass(frozen=True, slots=True)
class Result:
    """A row of the published table, as it is stored."""

    name: str
    fault: str
    promise: str
    test: str
    count: int
    unit: str
    result: str
    holds: bool


def _broken(**counts: object) -> tuple[str, ...]:
    return tuple(f"{name.replace('_', ' ')}: {count}" for name, count in counts.items() if count)


def _power(count: int, root: Path) -> Outcome:
    found = power.cut_power(count, SEED, root)
    result = f"{found.acknowledged} acknowledged, {found.lost} lost, {found.twice} twice"
    return Outcome(found.cuts, result, _broken(lost=found.lost, twice=found.twice, unproven=found.unproven))


def _damaged(damaged: Callable[[int, int, Path], damage.Damage]) -> Callable[[int, Path], Outcome]:
    def run(count: int, root: Path) -> Outcome:
        found = damaged(count, SEED, root)
        result = (
            f"{found.told} named by `verify`, {found.mended} noted as an unfinished write and completed, "
            f"{found.harmless} in bytes that hold nothing, {found.unnoticed} unnoticed; "
            f"{found.lost} rows lost, {found.refused} refused as of a newer version"
        )
        return Outcome(found.damaged, result, _broken(unnoticed=found.unnoticed, lost=found.lost))

    return run


def _kills(count: int, root: Path) -> Outcome:
    return _told(kills.kill_and_look(count, 0, SEED, root))


def _sync_kills(count: int, root: Path) -> Outcome:
    return _told(kills.kill_and_look(0, count, SEED, root))


def _told(found: kills.Kills) -> Outcome:
    roles = ", ".join(f"{role} {times}" for role, times in sorted(found.by_role.items()))
    result = (
        f"{found.acknowledged} acknowledged, {found.lost} lost, {found.twice} twice, "
        f"{found.unproven} unproven{'; ' * bool(roles)}{roles}; "
        f"acknowledged again after {found.back_ms_median} ms (median), {found.back_ms_worst} ms (worst)"
    )
    return Outcome(found.kills, result, _broken(lost=found.lost, twice=found.twice, unproven=found.unproven))


def _frames(sent: Callable[[int, int], fuzz.Frames]) -> Callable[[int, Path], Outcome]:
    def run(count: int, _: Path) -> Outcome:
        found = sent(count, SEED)
        result = (
            f"{found.types} types: {found.messages} messages, {found.refused} refused, "
            f"{sum(found.foreign.values())} other errors; memory grew by {found.grown_mb} MB"
        )
        fat = max(0, found.grown_mb - MEMORY_MB_MAX)
        return Outcome(
            found.frames, result, _broken(foreign=found.foreign, unfaithful=found.unfaithful, too_many_mb=fat)
        )

    return run


def _simulated(decisions: int) -> Callable[[int, Path], Outcome]:
    def run(count: int, _root: Path) -> Outcome:
        *_, (done, _last) = campaign(0, count, PROCESSES, decisions)
        result = (
            f"{done.fewest_decisions} decisions and more in each, {done.steps} steps in all, "
            f"{done.faults} faults, {len(done.failures)} failures"
        )
        return Outcome(count, result, tuple(f"{one.rule}: {one.repeat}" for one in done.failures))

    return run


def _too_long(name: str, count: int, seconds: float, seconds_max: float) -> float:
    """Return the seconds where they are too many: the bar is that of the full number."""
    return seconds if seconds > seconds_max and count >= named(name).full else 0.0


def _back(count: int, root: Path) -> Outcome:
    found = restart.kill_and_ask(count, root)
    slow = _too_long("restart", count, found.processor_s, BACK_SECONDS_MAX)
    result = f"after {found.seconds} s, {found.processor_s} s of processor time"
    if found.beside_s:
        result += f", beside it {found.beside_s} s for the proof of the journal"
    return Outcome(count, result, _broken(another_row=not found.same, too_slow_s=slow))


def _proof(count: int, root: Path) -> Outcome:
    found = restart.prove(count, root)
    slow = _too_long("verify", count, found.processor_s, SECONDS_MAX)
    result = f"{found.seconds} s, {found.processor_s} s of processor time"
    return Outcome(count, result, _broken(not_ok=not found.ok, too_slow_s=slow))


FAULTS = (
    Fault("power-cuts", "power cut, disk full and failing sync, at any commit (simulated disk)",
          "0 acknowledged labels lost, 0 twice", "test_a_power_cut_loses_no_acknowledged_label",
          300, 10_000, _power),
    Fault("bit-flips", "one bit of one journal file flipped", "noticed, and 0 acknowledged labels lost",
          "test_a_flipped_bit_is_noticed_and_loses_nothing", 150, 10_000, _damaged(damage.flip_bits)),
    Fault("cuts", "one journal file cut short", "noticed, and 0 acknowledged labels lost",
          "test_a_file_cut_short_is_noticed_and_loses_nothing", 100, 4_096, _damaged(damage.cut_ends)),
    Fault("kills", "SIGKILL of learner, aggregator, environment, gateway, router, up to five at once",
          "0 acknowledged labels lost, 0 counted twice, Q equal to replay",
          "test_killed_processes_lose_nothing_and_count_nothing_twice", 8, 500, _kills),
    Fault("sync-kills", "SIGKILL in the learner's 1st, 2nd ... sync of the disk, teaching going on",
          "0 acknowledged labels lost, 0 counted twice, Q equal to replay",
          "test_a_learner_killed_in_a_sync_loses_nothing", 3, 60, _sync_kills),
    Fault("restart", "learner killed with so many labels in its journal",
          f"acknowledges again within {BACK_SECONDS_MAX:.0f} s (quiet machine)",
          "test_a_learner_with_a_long_journal_acknowledges_again_soon", 10_000, 100_000, _back),
    Fault("verify", "`sfid verify` of a journal of so many labels",
          f"at most {SECONDS_MAX:.0f} s (quiet machine)",
          "test_a_long_journal_is_proven_soon", 50_000, 1_000_000, _proof),
    Fault("random-frames", "random bytes as every message type", "a message of the schema or DecodeError",
          "test_random_frames_are_refused_and_cost_no_memory", 2_000, 1_000_000, _frames(fuzz.send_random)),
    Fault("mutated-frames", "a good frame with 1 to 6 edits, of every message type",
          "a message of the schema or DecodeError",
          "test_mutated_frames_are_messages_or_refused", 2_000, 1_000_000, _frames(fuzz.send_mutated)),
    Fault("simulator", "messages lost, doubled, late, links cut, processes killed, clocks set, disks failing "
          "(short lessons)", "every rule R0 to R10", "test_every_rule_holds_in_the_simulator",
          16, 400, _simulated(0)),
    Fault("simulator-long", f"the same: {DECISIONS} decisions, three teachers, 20 trials and more a seed",
          "every rule R0 to R10", "test_every_rule_holds_in_long_lessons_of_the_simulator",
          2, 1_500, _simulated(DECISIONS)),
)  # fmt: skip
UNITS = {"restart": "labels", "verify": "labels", "random-frames": "frames", "mutated-frames": "frames",
         "simulator": "seeds", "simulator-long": "seeds", "kills": "kills", "sync-kills": "kills",
         "power-cuts": "cuts",
         "bit-flips": "flips", "cuts": "cuts"}  # fmt: skip


def named(name: str) -> Fault:
    """Return the fault of that name."""
    return next(fault for fault in FAULTS if fault.name == name)


def carry_out(fault: Fault, count: int) -> Outcome:
    """Carry a campaign out so often, in a directory of its own; what simulates its disk needs none."""
    memory = MEMORY if fault.name in IN_MEMORY and os.access(MEMORY, os.W_OK) else None
    with tempfile.TemporaryDirectory(prefix="sfid-faults-", dir=memory) as root:
        return fault.run(count, Path(root))


def _store(fault: Fault, outcome: Outcome) -> Result:
    result = Result(
        fault.name, fault.fault, fault.promise, f"{TESTS}::{fault.test}", outcome.tried, UNITS[fault.name],
        outcome.result, not outcome.broken,
    )  # fmt: skip
    RESULTS.mkdir(exist_ok=True)
    text = json.dumps(asdict(result), indent=2) + "\n"
    (RESULTS / f"{fault.name}.json").write_text(text, encoding="utf-8")
    return result


def main() -> None:
    """Carry out the campaigns named, or all, in full; a smaller share with --scale."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # what was started ends with it
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[*(fault.name for fault in FAULTS), []], default=[])
    parser.add_argument(
        "--scale", type=float, default=1.0, help="share of the full numbers; stores nothing below 1"
    )
    asked = parser.parse_args()
    for fault in FAULTS:
        if asked.names and fault.name not in asked.names:
            continue
        began = time.monotonic()
        outcome = carry_out(fault, max(1, int(fault.full * asked.scale)))
        if asked.scale >= 1:
            _store(fault, outcome)
        verdict = "; ".join(outcome.broken) or "holds"
        sys.stdout.write(
            f"{fault.name}: {outcome.tried} {UNITS[fault.name]}: {outcome.result}: {verdict} "
            f"({time.monotonic() - began:.0f} s, {os.cpu_count()} processors)\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
