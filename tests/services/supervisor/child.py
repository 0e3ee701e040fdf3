"""A supervisor in a process of its own, with a router under it: `child.py LOG_DIR ENDPOINT`."""

import sys
import threading
from pathlib import Path

from services.supervisor import Service, Supervisor


def main() -> None:
    """Start, say who runs, and wait to be killed."""
    supervisor = Supervisor(Path(sys.argv[1]))
    supervisor.start(Service("router", ("router", "--listen", sys.argv[2])))
    for name, pid in supervisor.processes():
        print(name, pid, flush=True)  # noqa: T201 - read by the test
    threading.Event().wait()


if __name__ == "__main__":
    main()
