"""Somebody who teaches on the page: a websocket to the gateway, opened again whenever it is lost."""

import json
import secrets
import threading
import time
from typing import Any

from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from tests.containers.counts import Tally

Frame = dict[str, Any]
KEPT = frozenset({"saved", "too_late"})
ON_THE_WAY = frozenset({"sending", "retrying"})
COPIED = ("session", "epoch", "decision", "episode", "step", "state")
RETRY_S = 0.5
QUIET_S = 4.0
"""As the page: who hears nothing for so long asks, and then opens a new connection."""


class PageTeacher:
    """Teaches in a thread of its own, answer by answer, until `close`."""

    def __init__(self, url: str, token: str, tally: Tally, pace_s: float) -> None:
        self._url, self._token, self._tally, self._pace_s = url, token, tally, pace_s
        self._nonce = secrets.token_hex(16)
        self._open: dict[str, Frame] = {}
        """Answers that nobody has acknowledged yet, as the page's storage keeps them."""
        self._seen: tuple[int, int] | None = None
        self._stop = threading.Event()
        self.trouble: dict[str, int] = {}
        """How often a connection ended, by reason."""
        self._thread = threading.Thread(target=self._run, name="page-teacher", daemon=True)
        self._thread.start()

    def close(self, wait_s: float = 10.0) -> int:
        """Answer no more, wait for what is on its way; return how many answers nobody acknowledged."""
        self._stop.set()
        self._thread.join(wait_s)
        return len(self._open)

    def _run(self) -> None:
        until: float | None = None
        while until is None or (self._open and time.monotonic() < until):
            until = time.monotonic() + QUIET_S if self._stop.is_set() else None
            try:
                with connect(
                    f"ws://{self._url.partition('://')[2]}/socket",
                    origin=Origin(self._url),
                    compression=None,
                    proxy=None,
                    open_timeout=QUIET_S,
                    close_timeout=0.5,
                ) as socket:
                    self._converse(socket)
            except (OSError, WebSocketException) as error:
                name = type(error).__name__
                self.trouble[name] = self.trouble.get(name, 0) + 1
                self._stop.wait(RETRY_S)

    def _converse(self, socket: ClientConnection) -> None:
        hello = {"type": "hello", "version": 1, "token": self._token, "nonce": self._nonce, "arrival": {}}
        socket.send(json.dumps(hello))
        greeted = False
        while not self._stop.is_set() or self._open:
            frame: Frame = json.loads(socket.recv(timeout=QUIET_S))
            if frame["type"] == "decision":
                if not greeted:
                    greeted = True
                    for said in self._open.values():
                        socket.send(json.dumps(said))
                self._see(socket, frame)
            elif frame["type"] == "answer" and frame["state"] not in ON_THE_WAY:
                self._settle(frame)

    def _settle(self, frame: Frame) -> None:
        if self._open.pop(frame["id"], None) is not None and frame["state"] in KEPT:
            self._tally.add(frame["id"])

    def _see(self, socket: ClientConnection, frame: Frame) -> None:
        number = (frame["epoch"], frame["decision"])
        if frame["phase"] != "asking" or number == self._seen or self._stop.wait(self._pace_s):
            return
        self._seen = number
        said = {name: frame[name] for name in COPIED}
        action = frame["actions"][frame["decision"] % len(frame["actions"])]
        said |= {"type": "answer", "id": secrets.token_hex(16), "kind": "label", "action": action}
        self._open[said["id"]] = said
        socket.send(json.dumps(said))
