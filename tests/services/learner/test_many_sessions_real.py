"""The benchmark of many sessions in small: real processes, and every answer is accounted for."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "sessions.py"
SESSIONS = 50


@pytest.mark.real
def test_fifty_sessions_in_one_learner_lose_no_answer() -> None:
    command = [sys.executable, str(BENCHMARK), "--sessions", str(SESSIONS), "--seconds", "3", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout.splitlines()[-1])
    taught = found["taught"]
    assert found["bars"]["none lost"] == "met"
    assert (taught["lost"], taught["acknowledged"], taught["journaled"]) == (
        0,
        taught["sent"],
        taught["sent"],
    )
    assert taught["sent"] > SESSIONS
