"""The viewer's web page on loopback.

`rr.serve_web_viewer` binds every interface of the machine. So the page's files are read once, at start, from
the viewer program of the wheel (bound to loopback, ended at once). They are served from here, on loopback,
with a content policy that lets the page call our two servers and nobody else: left alone it loads fonts and
reports use.
"""

import http.client
import json
import os
import subprocess
import tempfile
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

from services.monitor.config import LOOPBACK, Addresses, MonitorError, free_port, port_error

FILES = {
    "/": "text/html; charset=utf-8",
    "/re_viewer.js": "text/javascript",
    "/re_viewer_bg.wasm": "application/wasm",
    "/favicon.ico": "image/x-icon",
    "/apple-touch-icon.png": "image/png",
}
START_TIMEOUT_S = 10.0
BLOCK_BYTES = 1 << 18
CLIENT_TIMEOUT_S = 30.0

_PROGRAM_MEND = "install rerun-sdk whole, or set web_port to none and use the native viewer"


class Bundle:
    """The page's files, in an unnamed temporary file: no memory, and nothing left behind however we end."""

    def __init__(self, files: dict[str, bytes]) -> None:
        self._file: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the page
        self._places: dict[str, tuple[int, int]] = {}
        for path, content in files.items():
            self._places[path] = (self._file.tell(), len(content))
            self._file.write(content)
        self._file.flush()

    def place(self, path: str) -> tuple[int, int] | None:
        """Return (offset, bytes) of a file of the page, or None."""
        return self._places.get(path)

    def read(self, offset: int, length: int) -> bytes:
        """Return a part; safe from several threads at once."""
        return os.pread(self._file.fileno(), length, offset)

    def close(self) -> None:
        """Give the space back."""
        self._file.close()


class WebPage:
    """The page, served until `close`."""

    def __init__(self, bundle: Bundle, addresses: Addresses) -> None:
        port = addresses.web_port or 0
        servers = f"http://{LOOPBACK}:{addresses.scene_port} http://{LOOPBACK}:{addresses.curves_port}"
        policy = (
            "default-src 'self'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval'; "
            "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; worker-src 'self' blob:; "
            f"connect-src 'self' {servers}; frame-ancestors 'none'"
        )
        self._bundle = bundle
        try:
            self._server = _Server((addresses.bind, port), _handler(bundle, policy))
        except OSError:
            bundle.close()
            raise port_error("web_port", port) from None
        self._thread = threading.Thread(target=self._server.serve_forever, name="monitor-web", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving; downloads that are under way are cut."""
        self._server.shutdown()
        self._server.server_close()
        self._bundle.close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ANN401 - as the base class has it
        """Say nothing: a browser that goes away in the middle of a download is no error of ours."""


def _handler(bundle: Bundle, policy: str) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        timeout = CLIENT_TIMEOUT_S

        def do_GET(self) -> None:
            path = self.path.split("?")[0]
            place = bundle.place(path)
            if place is None:
                self.send_error(404)
                return
            offset, length = place
            self.send_response(200)
            self.send_header("Content-Type", FILES[path])
            self.send_header("Content-Length", str(length))
            # The page asks for the length by this name to draw its progress.
            self.send_header("rerun-final-length", str(length))
            self.send_header("Content-Security-Policy", policy)
            self.send_header("Cache-Control", "no-cache")
            self.end_headers()
            for at in range(offset, offset + length, BLOCK_BYTES):
                self.wfile.write(bundle.read(at, min(BLOCK_BYTES, offset + length - at)))

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - as the base class has it
            """Keep quiet: one line a download helps nobody."""

    return Handler


def viewer_program() -> Path:
    """Return the viewer's own program; its Python wrapper would leave it running. Raises MonitorError."""
    spec = find_spec("rerun_cli")
    folders = [] if spec is None else list(spec.submodule_search_locations or [])
    programs = [Path(folder, name) for folder in folders for name in ("rerun", "rerun.exe")]
    program = next((program for program in programs if program.is_file()), None)
    if program is None:
        raise MonitorError(
            f"the web page needs the viewer program of rerun-sdk, which is not there: {_PROGRAM_MEND}"
        )
    return program


def read_bundle() -> Bundle:
    """Return the page's files as the viewer program holds them. Raises MonitorError."""
    port = free_port(set())
    with tempfile.TemporaryDirectory(prefix="sfid-monitor-") as folder:
        command = [str(viewer_program()), "--serve-web", "--bind", LOOPBACK, "--web-viewer-port", str(port)]
        # It serves the page alone, and no data, when it is given an address to view; nobody opens this one.
        command.append(f"rerun+http://{LOOPBACK}:{port}/proxy")
        process = subprocess.Popen(
            command,
            env=_environment(Path(folder)),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            _await_listening(port, process)
            return Bundle({path: _fetched(port, path) for path in FILES})
        except (OSError, http.client.HTTPException) as error:
            message = f"the viewer program does not hand out its web page ({error}): {_PROGRAM_MEND}"
            raise MonitorError(message) from None
        finally:
            process.kill()
            process.wait()


def _environment(folder: Path) -> dict[str, str]:
    """Return an environment in which the program reports nothing and leaves nothing in the person's home."""
    settings = folder / "rerun" / "analytics.json"
    settings.parent.mkdir()
    content = {
        "analytics_enabled": False,
        "analytics_id": "none",
        "metadata": {},
        "config_file_path": str(settings),
        "data_dir_path": str(folder / "analytics"),
    }
    settings.write_text(json.dumps(content))
    return {"HOME": str(folder), "XDG_CONFIG_HOME": str(folder), "RUST_LOG": "error"}


def _await_listening(port: int, process: subprocess.Popen[bytes]) -> None:
    deadline_s = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline_s and process.poll() is None:
        try:
            _fetched(port, "/favicon.ico")
        except OSError:
            time.sleep(0.02)
        else:
            return
    message = "it did not start"
    raise OSError(message)


def _fetched(port: int, path: str) -> bytes:
    connection = http.client.HTTPConnection(LOOPBACK, port, timeout=START_TIMEOUT_S)
    try:
        connection.request("GET", path)
        response = connection.getresponse()
        if response.status != http.client.OK:
            message = f"{path}: {response.status} {response.reason}"
            raise OSError(message)
        return response.read()
    finally:
        connection.close()
