"""The campaigns bite: bugs planted in a copy of the packages are found by the campaign that is for them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.simulation.planted import ROOT, Bug, plant

RUN = """
import json, sys
from pathlib import Path
from tests.services.faults.campaigns import carry_out, named
fault = named(sys.argv[1])
print(json.dumps(carry_out(fault, int(sys.argv[2])).broken))
"""
JOURNAL = "services/runtime/journal"
BUGS = (
    (
        "power-cuts",
        200,
        Bug(
            "what only the mirror holds is not brought back",
            "unproven",
            f"{JOURNAL}/opening.py",
            "            store.advance(head.epoch, found.ahead[-1])\n            store.commit(found.ahead)\n",
            "",
        ),
    ),
    (
        "power-cuts",
        200,
        Bug(
            "what only SQLite holds is not brought to the mirror",
            "unproven",
            f"{JOURNAL}/opening.py",
            '            mirror.write(b"".join(found.behind))\n',
            '            mirror.write(b"")\n',
        ),
    ),
    (
        "bit-flips",
        900,
        Bug(
            "the indexes are not looked at",
            "lost",
            f"{JOURNAL}/audit.py",
            "            found.problems += problems\n",
            "",
        ),
    ),
    (
        "mutated-frames",
        300,
        Bug(
            "an error of the decoder gets out",
            "foreign",
            "protocol/codec.py",
            "    except (ValueError, TypeError, RecursionError, OverflowError, msgpack.UnpackException)",
            "    except (RecursionError, OverflowError)",
        ),
    ),
)


@pytest.mark.parametrize("name, times, bug", BUGS, ids=[f"{name}: {bug.name}" for name, _, bug in BUGS])
def test_a_planted_bug_is_found_by_its_campaign(name: str, times: int, bug: Bug, tmp_path: Path) -> None:
    where = plant(bug, tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", RUN, name, str(times)], cwd=where, capture_output=True, text=True, timeout=110,
        check=False, env=dict(os.environ) | {"PYTHONPATH": f"{where}:{ROOT}", "PYTHONDONTWRITEBYTECODE": "1"},
    )  # fmt: skip
    if done.returncode != 0:  # it may also stop the journal from opening at all
        assert "Journal" in done.stderr, done.stderr
        return
    broken = json.loads(done.stdout.splitlines()[-1])
    assert any(line.startswith(bug.rule) for line in broken), broken
