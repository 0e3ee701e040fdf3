"""The monitor service: watches the sessions of a deployment, shows them live in Rerun, and records them.

It only reads topics that may be dropped, and nothing waits for it: a slow viewer, a frozen one, or none
changes nothing for those who teach. It is disposable: started anew, it fills the curves from the learner.
"""

import logging
import os
import sys
import threading
from collections.abc import Callable

from services.monitor.config import Addresses, MonitorConfig, MonitorError, chosen_ports
from services.monitor.live import Live
from services.monitor.recordings import check_folder
from services.monitor.web import WebPage, read_bundle
from services.monitor.worker import MonitorCounts, Worker
from services.runtime.bus import Bus
from services.runtime.clock import Clock, SystemClock

__all__ = ["MonitorConfig", "MonitorCounts", "MonitorError", "run"]

POLL_S = 0.2
FILES_TIMEOUT_S = 3.0
VIEWERS_TIMEOUT_S = 1.5
"""Files, then viewers: together under the five seconds in which every service ends. Where no viewer is
served, the files have the time of both."""

_LOG = logging.getLogger(__name__)


def run(
    config: MonitorConfig,
    bus: Bus,
    ready: Callable[[str], None],
    stop: threading.Event,
    *,
    clock: Clock | None = None,
    leave: Callable[[int], None] = os._exit,
) -> MonitorCounts:
    """Watch until `stop` is set; `ready` is called once with where to watch, a line for each way.

    Ends within five seconds of `stop`: the files are closed first, and where a frozen viewer then holds the
    servers, `leave` ends the process, because neither a thread nor Python's own exit can get past it.

    Raises MonitorError when a port is taken or a recording cannot be written.
    """
    if config.recording_dir is not None:
        check_folder(config.recording_dir)
    addresses = chosen_ports(config) if config.viewer else None
    live = None if addresses is None else Live(addresses)
    page = None if addresses is None else _page(addresses, live)
    worker = Worker(config, bus, live, clock or SystemClock())
    failures: list[BaseException] = []
    thread = threading.Thread(target=_work, args=(worker, stop, failures), name="monitor-worker", daemon=True)
    try:
        worker.subscribe()
        thread.start()
        ready(_where(config, addresses, page))
        while not stop.wait(POLL_S) and thread.is_alive():
            pass
    finally:
        stop.set()
        _end(thread, live, page, leave)
    if failures:
        raise failures[0]
    if live is not None:
        worker.counts.dropped_rows = live.dropped
    return worker.counts


def _work(worker: Worker, stop: threading.Event, failures: list[BaseException]) -> None:
    try:
        worker.run(stop.is_set)
    except BaseException as error:  # noqa: BLE001 - handed to the thread that waits, and raised there
        failures.append(error)


def _page(addresses: Addresses, live: Live | None) -> WebPage | None:
    """Serve the page; without the program that holds it, the native viewer is still there."""
    if addresses.web_port is None:
        return None
    try:
        bundle = read_bundle()
    except MonitorError as error:
        _LOG.warning("%s", error)
        return None
    try:
        return WebPage(bundle, addresses)
    except MonitorError:
        if live is not None:
            live.close(VIEWERS_TIMEOUT_S)
        raise


def _where(config: MonitorConfig, addresses: Addresses | None, page: WebPage | None) -> str:
    lines = []
    if addresses is not None:
        if page is not None:
            lines.append(f"watch in a browser: {addresses.web_url}")
        lines.append(f"watch in the viewer: {addresses.native_command}")
    if config.recording_dir is not None:
        lines.append(f"recordings: {config.recording_dir}")
    return "\n".join(lines) or "nothing to watch: no viewer and no recording is wanted"


def _end(
    thread: threading.Thread, live: Live | None, page: WebPage | None, leave: Callable[[int], None]
) -> None:
    if thread.ident is not None:
        thread.join(FILES_TIMEOUT_S if live is not None else FILES_TIMEOUT_S + VIEWERS_TIMEOUT_S)
    closed = not thread.is_alive()
    if page is not None:
        page.close()
    if live is not None and not live.close(VIEWERS_TIMEOUT_S):
        _LOG.warning("a viewer hangs and holds the servers: ended without it, the recordings are whole")
        closed = False
    if not closed:
        sys.stdout.flush()
        sys.stderr.flush()
        leave(0)
