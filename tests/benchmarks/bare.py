"""Bare Zenoh processes: the same messages over the same router, without codec, journal, session or learning.

Run as `python tests/benchmarks/bare.py ROLE ENDPOINT`; it prints "ready" and serves until its stdin closes.
"""

import json
import queue
import sys
import threading
from collections.abc import Callable
from typing import Any

import zenoh

from services.runtime.zenoh_config import client_config

ROOT = "bare"
PAYLOAD = b"x" * 220
"""About the size of an answer."""


def open_session(endpoint: str) -> zenoh.Session:
    """Return a client session configured as the project's own are."""
    return zenoh.open(zenoh.Config.from_json5(json.dumps(client_config(endpoint))))


def direct(callback: Callable[[Any], None]) -> "zenoh.handlers.Callback[Any]":
    """Return a handler that runs on Zenoh's own thread, as the project's are."""
    return zenoh.handlers.Callback(callback, indirect=False)


def echo(session: zenoh.Session) -> None:
    """Answer each query at once: the bare round trip."""
    key = f"{ROOT}/echo"
    session.declare_queryable(key, direct(lambda query: query.reply(key, PAYLOAD[:80])))


def environment(session: zenoh.Session) -> None:
    """Answer each execute at once."""
    key = f"{ROOT}/execute"
    session.declare_queryable(key, direct(lambda query: query.reply(key, PAYLOAD)))


def learner(session: zenoh.Session) -> None:
    """Acknowledge an answer, have the action executed, publish the next decision: a lock-step round."""
    inbox: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()
    key = f"{ROOT}/answer"
    session.declare_queryable(key, direct(lambda query: inbox.put(("answer", query))))

    def loop() -> None:
        while True:
            what, item = inbox.get()
            if what == "answer":
                session.get(
                    f"{ROOT}/execute",
                    direct(lambda reply: inbox.put(("executed", reply))),
                    payload=PAYLOAD,
                    timeout=2.0,
                )
                item.reply(key, PAYLOAD[:120])
                del item
            else:
                session.put(f"{ROOT}/decision", PAYLOAD * 2)

    threading.Thread(target=loop, daemon=True).start()


def main() -> None:
    """Serve one role until stdin closes."""
    role, endpoint = sys.argv[1:]
    with open_session(endpoint) as session:
        {"echo": echo, "environment": environment, "learner": learner}[role](session)
        print("ready", flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main()
