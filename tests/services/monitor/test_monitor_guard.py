"""The guard before the viewers: it passes bytes on, cuts who stalls, and holds nobody up."""

import contextlib
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from services.monitor.config import LOOPBACK, free_port
from services.monitor.guard import Guard, Limits

pytestmark = pytest.mark.real

DEADLINE_S = 30.0


class Server:
    """Sends each that connects as much as it is told, as fast as they take it."""

    def __init__(self) -> None:
        self._socket = socket.create_server((LOOPBACK, 0))
        self.port: int = self._socket.getsockname()[1]
        self.sent = threading.Semaphore(0)
        self._go = threading.Thread(target=self._serve, daemon=True)
        self.length = 0
        self.pieces: list[bytes] = []
        """Sent instead of so many bytes, one after another; then the server hangs up."""
        self._go.start()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._socket.accept()
            except OSError:
                return
            threading.Thread(target=self._send, args=(connection,), daemon=True).start()

    def _send(self, connection: socket.socket) -> None:
        with connection:
            assert connection.recv(5) == b"hello"
            try:
                for piece in self.pieces or [b"x" * self.length]:
                    connection.sendall(piece)
            except OSError:
                return
            if self.pieces:
                return
            self.sent.release()
            connection.recv(1)

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def server() -> Iterator[Server]:
    serving = Server()
    yield serving
    serving.close()


def connected(port: int) -> socket.socket:
    viewer = socket.create_connection((LOOPBACK, port), timeout=DEADLINE_S)
    with contextlib.suppress(ConnectionError):  # whoever is turned away may be gone by now
        viewer.sendall(b"hello")
    return viewer


def received(viewer: socket.socket, length: int) -> int:
    got = 0
    with contextlib.suppress(ConnectionResetError):  # as a cut may look
        while got < length and (data := viewer.recv(1 << 16)):
            got += len(data)
    return got


def test_a_viewer_who_takes_nothing_holds_up_neither_the_server_nor_another(server: Server) -> None:
    server.length = 24 << 20
    port = free_port(set())
    guard = Guard([(port, server.port)], LOOPBACK, LOOPBACK)
    try:
        with connected(port) as frozen, connected(port) as awake:
            assert received(awake, server.length) == server.length
            # Both were sent everything: the guard keeps the frozen one's part.
            assert server.sent.acquire(timeout=DEADLINE_S)
            assert server.sent.acquire(timeout=DEADLINE_S)
            assert frozen.fileno() >= 0
    finally:
        guard.close()


def test_a_viewer_who_stalls_is_cut_and_the_others_stay(server: Server) -> None:
    server.length = 24 << 20
    port = free_port(set())
    limits = Limits(stalled_s=0.4, look_s=0.1)
    guard = Guard([(port, server.port)], LOOPBACK, LOOPBACK, limits)
    try:
        with connected(port) as frozen, connected(port) as awake:
            assert received(awake, server.length) == server.length
            assert server.sent.acquire(timeout=DEADLINE_S)
            assert server.sent.acquire(timeout=DEADLINE_S)
            pause = threading.Event()
            for _ in range(int(DEADLINE_S * 20)):
                if guard.cut:
                    break
                pause.wait(0.05)
            assert guard.cut == 1
            assert received(frozen, server.length) < server.length
            awake.sendall(b"!")
    finally:
        guard.close()


def test_a_viewer_too_far_behind_is_cut(server: Server) -> None:
    server.length = 64 << 20
    port = free_port(set())
    guard = Guard([(port, server.port)], LOOPBACK, LOOPBACK, Limits(waiting_max=4 << 20))
    try:
        with connected(port) as frozen:
            assert not server.sent.acquire(timeout=1.0)
            assert received(frozen, server.length) < server.length
            assert guard.cut == 1
    finally:
        guard.close()


def test_every_viewer_gets_every_byte_in_order_also_those_sent_before_the_server_hung_up(
    server: Server,
) -> None:
    """Small pieces wait for the viewer's turn and large ones do not, so that they meet."""
    server.pieces = [bytes([number % 251]) * (1 << number % 20) for number in range(100)]
    whole = b"".join(server.pieces)
    port = free_port(set())
    guard = Guard([(port, server.port)], LOOPBACK, LOOPBACK)
    try:
        with ExitStack() as stack:
            viewers = [stack.enter_context(connected(port)) for _ in range(4)]
            for viewer in viewers:
                assert b"".join(iter(lambda: viewer.recv(1 << 16), b"")) == whole  # noqa: B023 - read at once
        assert guard.cut == 0
    finally:
        guard.close()


def test_one_viewer_more_than_there_may_be_is_turned_away_until_another_leaves(server: Server) -> None:
    server.length = 1
    port = free_port(set())
    guard = Guard([(port, server.port)], LOOPBACK, LOOPBACK, Limits(viewers_max=2))
    try:
        with connected(port) as one, connected(port) as two:
            assert (received(one, 1), received(two, 1)) == (1, 1)
            with connected(port) as three:
                assert received(three, 1) == 0
            one.close()
            assert any(comes_in(port) for _ in range(200))
            assert guard.cut == 0
    finally:
        guard.close()


def comes_in(port: int) -> bool:
    with connected(port) as viewer:
        return received(viewer, 1) == 1


def test_a_viewer_of_a_server_that_is_gone_is_let_go_with_a_line(
    server: Server, caplog: pytest.LogCaptureFixture
) -> None:
    gone, port = free_port({server.port}), free_port({server.port})
    guard = Guard([(port, gone)], LOOPBACK, LOOPBACK)
    try:
        with connected(port) as viewer:
            assert received(viewer, 1) == 0
    finally:
        guard.close()
    assert "a viewer cannot be served" in caplog.text


def test_a_taken_port_is_an_error_and_nothing_is_left_running(server: Server) -> None:
    before = threading.active_count()
    with pytest.raises(OSError, match="in use"):
        Guard([(server.port, server.port)], LOOPBACK, LOOPBACK)
    assert threading.active_count() == before
