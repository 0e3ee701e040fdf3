"""The guard before the viewers: it passes bytes on, cuts who stalls, and holds nobody up."""

import contextlib
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from services.monitor.config import LOOPBACK, free_port
from services.monitor.guard import TURN_S, Guard, Limits, free_turn

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
        with connection, contextlib.suppress(OSError):  # whoever is cut, or ends first, resets the connection
            if connection.recv(5) != b"hello":
                return
            for piece in self.pieces or [b"x" * self.length]:
                connection.sendall(piece)
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
    guard = Guard([(port, server.port)], LOOPBACK, LOOPBACK, Limits(connections_max=2))
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


def test_whoever_says_nothing_is_cut_and_makes_room(server: Server) -> None:
    server.length = 1
    port = free_port(set())
    limits = Limits(silent_s=0.2, look_s=0.05, connections_max=2)
    guard = Guard([(port, server.port)], LOOPBACK, LOOPBACK, limits)
    try:
        with connected(port) as viewer, socket.create_connection((LOOPBACK, port), DEADLINE_S) as silent:
            assert received(viewer, 1) == 1
            assert guard.viewers == 1
            assert received(silent, 1) == 0
            with connected(port) as another:
                assert received(another, 1) == 1
            viewer.sendall(b"!")
            assert guard.cut == 1
    finally:
        guard.close()


def test_a_slow_viewer_who_goes_on_taking_is_not_cut(server: Server) -> None:
    server.length = 32 << 20
    port, pause = free_port(set()), threading.Event()
    guard = Guard([(port, server.port)], LOOPBACK, LOOPBACK, Limits(stalled_s=1.0, look_s=0.1))
    try:
        with connected(port) as slow:
            for _ in range(20):
                assert received(slow, 1 << 19) >= 1 << 19
                pause.wait(0.1)
            assert guard.cut == 0
    finally:
        guard.close()


def test_of_all_that_waits_too_much_the_viewer_furthest_behind_is_cut(server: Server) -> None:
    server.length = 32 << 20
    port, pause = free_port(set()), threading.Event()
    limits = Limits(stalled_s=DEADLINE_S, look_s=2.0, all_waiting_max=26 << 20)
    guard = Guard([(port, server.port)], LOOPBACK, LOOPBACK, limits)
    try:
        with connected(port) as nearer, connected(port) as further:
            got = received(nearer, 20 << 20)
            for _ in range(int(DEADLINE_S * 20)):
                if guard.cut:
                    break
                pause.wait(0.05)
            assert guard.cut == 1
            assert got + received(nearer, server.length - got) >= server.length
            assert received(further, server.length) < server.length
    finally:
        guard.close()


@pytest.mark.parametrize("taken,turn", [(set(), 0), ({0, 1}, 2), ({0, 2}, 1), ({1, 2}, 0)])
def test_a_turn_that_somebody_left_is_taken_again(taken: set[int], turn: int) -> None:
    assert free_turn(taken) == turn


def test_what_comes_at_once_goes_to_one_viewer_after_the_other() -> None:
    port, viewers = free_port(set()), 8
    with socket.create_server((LOOPBACK, 0)) as upstream, ExitStack() as stack:
        guard = Guard([(port, upstream.getsockname()[1])], LOOPBACK, LOOPBACK)
        stack.callback(guard.close)
        upstream.settimeout(DEADLINE_S)
        watching, ways = [], []
        for _ in range(
            viewers
        ):  # one is led to the server before the next one comes: so they have their turns
            watching.append(stack.enter_context(connected(port)))
            ways.append(stack.enter_context(upstream.accept()[0]))
        sent_s = time.monotonic()
        for way in ways:
            way.sendall(b"x")
        came_s = []
        for viewer in watching:
            assert viewer.recv(1) == b"x"
            came_s.append(time.monotonic() - sent_s)
    # No viewer before its turn, however busy the machine is: a timer may be late and is never early.
    assert [turn for turn in range(viewers) if came_s[turn] < turn * TURN_S] == []
    assert TURN_S == 0.005


def test_a_viewer_can_say_more_than_fits_on_the_way_to_a_server_that_hears_late() -> None:
    length, port, hear = 64 << 20, free_port(set()), threading.Event()
    with socket.create_server((LOOPBACK, 0)) as late:
        guard = Guard([(port, late.getsockname()[1])], LOOPBACK, LOOPBACK)
        heard: list[int] = []

        def listen() -> None:
            connection, _ = late.accept()
            with connection:
                hear.wait(DEADLINE_S)
                heard.append(received(connection, length))

        said = threading.Thread(target=lambda: viewer.sendall(b"x" * length), daemon=True)
        hearing = threading.Thread(target=listen, daemon=True)
        hearing.start()
        try:
            with socket.create_connection((LOOPBACK, port), DEADLINE_S) as viewer:
                said.start()
                said.join(1.0)
                assert said.is_alive()  # it is held back, not kept in memory
                hear.set()
                hearing.join(DEADLINE_S)
                assert heard == [length]
        finally:
            guard.close()


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
