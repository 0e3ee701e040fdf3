"""The two servers that viewers connect to, fed by a thread of their own: no other waits for a viewer.

A viewer that hangs blocks the server's broadcast, and with it whoever logs. So rows for viewers go through a
bounded queue that drops its oldest. A dropped picture is followed by a newer one; a dropped row of a curve
is in the recording, and comes back from the learner when the monitor starts anew.
"""

import logging
import socket
import threading

import rerun as rr
import rerun_bindings

from services.monitor.blueprint import blueprint
from services.monitor.config import LOOPBACK, Addresses, MonitorError, free_port, port_error
from services.monitor.guard import Guard
from services.monitor.rows import Document, Picture, Row, Rows
from services.monitor.status import NOW
from services.monitor.waiting_rows import WaitingRows
from services.monitor.writer import APPLICATION, NamedActions, Writer, stream

SCENE_TICK_S = 0.1
CURVES_TICK_S = 0.5
SCENE_HISTORY = "32MB"
CURVES_HISTORY = "128MB"
START_TIMEOUT_S = 5.0
CLOSE_TIMEOUT_S = 1.0
VIEWERS_AT_FULL_PACE = 4
"""Beyond so many viewers each is shown less, so that all of them cost little more."""

_LOG = logging.getLogger(__name__)


class Live:
    """The servers, and every session's two streams to them.

    Servers outlive sessions and are there before the first: each belongs to an empty stream of kind
    blueprint, which no viewer lists; the sessions' streams connect to it over loopback.
    """

    def __init__(self, addresses: Addresses) -> None:
        self._addresses = addresses
        self._rows = WaitingRows()
        self._sessions: dict[str, _LiveSession] = {}
        self._blueprint_sent = False
        inner = _inner_ports(addresses)
        self._inner = inner
        self._scene_host = _host(addresses, inner.scene_port, "scene_port", SCENE_HISTORY)
        try:
            self._curves_host = _host(addresses, inner.curves_port, "curves_port", CURVES_HISTORY)
        except MonitorError:
            self._scene_host.disconnect()
            raise
        self._guard = self._guarded(addresses, inner)
        self._thread = threading.Thread(target=self._run, name="monitor-live", daemon=True)
        self._thread.start()

    def _guarded(self, addresses: Addresses, inner: Addresses) -> Guard:
        pairs = [(addresses.scene_port, inner.scene_port), (addresses.curves_port, inner.curves_port)]
        try:
            return Guard(pairs, addresses.bind, LOOPBACK)
        except OSError:
            self._scene_host.disconnect()
            self._curves_host.disconnect()
            raise port_error(*_taken_of(addresses)) from None

    @property
    def dropped(self) -> int:
        """Rows that viewers were too slow for."""
        return self._rows.dropped

    @property
    def cut(self) -> int:
        """Connections of viewers that were cut."""
        return self._guard.cut

    @property
    def pace(self) -> int:
        """How many times as long as usual viewers wait for the next picture, 1 or more."""
        return max(1, -(-self._guard.viewers // VIEWERS_AT_FULL_PACE))

    def show(self, recording_id: str, rows: Rows) -> None:
        """Queue rows for the viewers; never waits."""
        self._rows.put(recording_id, *rows.scene, *rows.curves)

    def forget(self, recording_id: str) -> None:
        """Close a session's streams once its queued rows are through; viewers keep what they have."""
        self._rows.put(recording_id, None)

    def close(self, timeout_s: float) -> bool:
        """Send what is queued and close; False when that did not end in time, because a viewer hangs."""
        self._rows.close()
        self._thread.join(timeout_s)
        self._guard.close()
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            while (item := self._rows.take()) is not None:
                self._write(*item)
        finally:
            for session in self._sessions.values():
                session.close()
            self._scene_host.disconnect()
            self._curves_host.disconnect()

    def _write(self, recording_id: str, row: Row | None) -> None:
        if row is None:
            if (session := self._sessions.pop(recording_id, None)) is not None:
                session.close()
            return
        if recording_id not in self._sessions:
            self._sessions[recording_id] = _LiveSession(
                recording_id, self._inner, with_blueprint=not self._blueprint_sent
            )
            self._blueprint_sent = True
        self._sessions[recording_id].write(row)


def is_of_the_moment(row: Row) -> bool:
    """Tell whether a row is shown while it lasts, so that a late viewer needs the last one alone.

    Hours of them would push the curves out of what their server remembers.
    """
    return isinstance(row, Picture) or (isinstance(row, Document) and row.entity == NOW)


class _LiveSession:
    """A session's two streams: one recording to a viewer that has opened both servers."""

    def __init__(self, recording_id: str, addresses: Addresses, *, with_blueprint: bool) -> None:
        self._scene = stream(recording_id, SCENE_TICK_S, send_properties=False)
        self._scene.set_sinks(rr.GrpcSink(addresses.scene_url))
        self._curves = stream(recording_id, CURVES_TICK_S, send_properties=True)
        self._curves.set_sinks(rr.GrpcSink(addresses.curves_url))
        self._curves.send_recording_name(recording_id)
        if with_blueprint:
            self._curves.send_blueprint(blueprint(), make_active=True, make_default=True)
        actions: NamedActions = {}
        self._scene_writer = Writer(self._scene, actions)
        self._curves_writer = Writer(self._curves, actions)
        self._curves_writer.style_curves()

    def write(self, row: Row) -> None:
        """Send a row to the server it belongs to."""
        (self._scene_writer if is_of_the_moment(row) else self._curves_writer).write(row)

    def close(self) -> None:
        """Send what is left; a server that hangs is left behind."""
        for each in (self._scene, self._curves):
            try:
                each.flush(timeout_sec=CLOSE_TIMEOUT_S)
            except RuntimeError as error:
                _LOG.warning("the last rows did not reach the viewers: %s", error)
            each.disconnect()


def _taken_of(addresses: Addresses) -> tuple[str, int]:
    """Return the field and the number of the port that the guard could not have."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((addresses.bind, addresses.scene_port))
        except OSError:
            return "scene_port", addresses.scene_port
    return "curves_port", addresses.curves_port


def _inner_ports(addresses: Addresses) -> Addresses:
    """Where the servers themselves listen: on loopback, behind the guard."""
    taken = {addresses.scene_port, addresses.curves_port, addresses.web_port or 0}
    scene = free_port(taken)
    return Addresses(scene, free_port(taken | {scene}), addresses.web_port)


def _host(addresses: Addresses, port: int, field: str, history: str) -> rr.RecordingStream:
    """Start a server and make sure that it listens. Raises MonitorError."""
    native = rerun_bindings.new_blueprint(
        application_id=APPLICATION, make_default=False, make_thread_default=False, default_enabled=True
    )
    host = rr.RecordingStream._from_native(native)  # noqa: SLF001 - the pinned release has no public way
    pages = [f"http://{name}:{addresses.web_port}" for name in (LOOPBACK, "localhost")]
    host.set_sinks(
        rr.GrpcServerSink(
            LOOPBACK, port, server_memory_limit=history, newest_first=False, cors_allow_origin=pages
        )
    )
    try:
        host.flush(timeout_sec=START_TIMEOUT_S)
    except RuntimeError:
        host.disconnect()
        raise port_error(field, port) from None
    return host
