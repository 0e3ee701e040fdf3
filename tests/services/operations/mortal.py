"""Running something in a process that is killed when it touches files for the n-th time."""

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable
from typing import Any

TOUCHES = {"open", "os.rename", "os.remove", "os.truncate", "sqlite3.connect"}
DEADLINE_S = 60.0


def code_when_killed_at(moment: int, do: Callable[..., None], *arguments: Any) -> int:  # noqa: ANN401
    """Return the exit code of a process that does it: 0 where it came to its end before that moment."""
    context = multiprocessing.get_context("forkserver")  # imports are paid for once
    context.set_forkserver_preload([do.__module__])
    process = context.Process(target=_die_at, args=(moment, do, arguments))
    process.start()
    process.join(DEADLINE_S)
    code = process.exitcode
    process.kill()
    process.join()
    process.close()
    assert code is not None, f"not done within {DEADLINE_S} s"
    return code


def _die_at(moment: int, do: Callable[..., None], arguments: tuple[Any, ...]) -> None:
    left = moment

    def hook(event: str, _arguments: object) -> None:
        nonlocal left
        if event in TOUCHES:
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)
    do(*arguments)
