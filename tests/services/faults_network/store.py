"""Keep the results of the last run of these tests for RELIABILITY.md.

.venv/bin/pytest tests/services/faults_network
.venv/bin/python -m tests.services.faults_network.store
.venv/bin/python -m tests.services.faults.table
"""

import json
import sys

from tests.services.faults.campaigns import RESULTS
from tests.services.faults.table import ROOT
from tests.services.faults_network.conftest import CACHE

CACHED = ROOT / ".pytest_cache" / "v" / CACHE


def main() -> None:
    """Copy every result from the cache to the stored ones."""
    RESULTS.mkdir(exist_ok=True)
    for path in sorted(CACHED.iterdir()):
        row = json.loads(path.read_text(encoding="utf-8"))
        text = json.dumps(row, indent=1, ensure_ascii=False) + "\n"
        (RESULTS / f"{path.name}.json").write_text(text, encoding="utf-8")
        sys.stdout.write(f"{row['fault']} {row['result']}\n")


if __name__ == "__main__":
    main()
