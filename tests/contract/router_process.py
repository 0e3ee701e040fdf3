"""A router in a process of its own, for tests that need a real one to talk through, to kill or to stop."""

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

_ROUTE = """
import sys, threading
from pathlib import Path
from services.router import RouterConfig, run
stop = threading.Event()
threading.Thread(target=lambda: (sys.stdin.read(), stop.set()), daemon=True).start()
access = Path(sys.argv[2]) if sys.argv[2] else None
config = RouterConfig(sys.argv[1], tuple(sys.argv[3:]), access=access)
run(config, lambda: print("ready", flush=True), stop)
"""


@contextmanager
def router_process(
    endpoint: str, access: Path | None = None, connect: Sequence[str] = ()
) -> Iterator[subprocess.Popen[str]]:
    """Run a router at `endpoint` in another process; it ends with the block, or with this process.

    Args: access: directory of logins; None: it asks nobody.  connect: other routers to link with.
    """
    command = [sys.executable, "-c", _ROUTE, endpoint, str(access or ""), *connect]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()
            process.wait()
