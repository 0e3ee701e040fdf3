"""RELIABILITY.md, made of the results that the campaigns stored: `python -m tests.services.faults.table`."""

import json
from pathlib import Path

from tests.services.faults.campaigns import FAULTS, RESULTS, Result

ROOT = Path(__file__).resolve().parents[3]
TABLE = ROOT / "RELIABILITY.md"
HEADER = """\
# Reliability

What is promised for each fault, the test that tries it, how often it was tried in full, and what came of it.
This file is made of the stored results (`tests/services/faults/results/`); a test compares.

    .venv/bin/pytest tests/services/faults                            the share of CI, with its counts
    .venv/bin/python -m tests.services.faults.campaigns [NAME ...]    the full numbers; stores the results
    .venv/bin/python -m tests.services.faults.table                   this file, from the results

| fault | promise | tried | result | holds | test |
|---|---|---|---|---|---|
"""
FOOTER = """
Damage is done to one file at a time: a row that is missing from both is refused with a count, not mended.
"Bytes that hold nothing" are free space and what a later page has taken the place of. A simulated power cut
keeps what either file had synced at that moment; whether a disk tells the truth cannot be tested here.

More of the simulator: `sfid simulate --seeds N [--decisions 200]`. A decision is some 70 messages, turns and
timers, with its journal, faults and checks between 1 and 2 ms of processor time. So 10,000 seeds of 200
decisions, three teachers and twenty trials each do not fit into five minutes on two cores; about 1,500 do.
"""


def stored() -> list[Result]:
    """Return all stored results, those of this directory first, others by name."""
    order = [fault.name for fault in FAULTS]
    found = [
        Result(**json.loads(path.read_text(encoding="utf-8"))) for path in sorted(RESULTS.glob("*.json"))
    ]
    return sorted(
        found, key=lambda one: (order.index(one.name) if one.name in order else len(order), one.name)
    )


def render(results: list[Result]) -> str:
    """Return the text of RELIABILITY.md."""
    return HEADER + "".join(map(_row, results)) + FOOTER


def _row(one: Result) -> str:
    holds = "yes" if one.holds else "NO"
    cells = (one.fault, one.promise, f"{one.count:,} {one.unit}", one.result, holds, f"`{one.test}`")
    return f"| {' | '.join(cells)} |\n"


def main() -> None:
    """Write the file."""
    TABLE.write_text(render(stored()), encoding="utf-8")


if __name__ == "__main__":
    main()
