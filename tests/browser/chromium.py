"""A real Chromium driven over its DevTools protocol as a person would: keys, fingers, reload, no network."""

import base64
import itertools
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

START_S = 30.0
WAIT_S = 10.0
POLL_S = 0.02
KEYS = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "Tab": 9, "Enter": 13, " ": 32}


def program() -> str | None:
    """Return where a Chromium is, if one is installed."""
    return shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


class Wire:
    """One DevTools connection: commands and their results; events are kept by name."""

    def __init__(self, address: str) -> None:
        self._stack = ExitStack()
        connection = connect(address, max_size=None, compression=None, ping_interval=None)
        self._socket: ClientConnection = self._stack.enter_context(connection)
        self._numbers = itertools.count(1)
        self.events: list[dict[str, Any]] = []

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:  # noqa: ANN401 - DevTools values
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=WAIT_S))
            if message.get("id") == number:
                assert "error" not in message, f"{method}: {message['error']}"
                return dict(message["result"])
            self.events.append(message)

    def look(self, wait_s: float) -> None:
        """Take in an event, if one comes within `wait_s`."""
        with suppress(TimeoutError):
            self.events.append(json.loads(self._socket.recv(timeout=wait_s)))

    def close(self) -> None:
        self._stack.close()


class Tab:
    """One tab of one person."""

    def __init__(
        self, address: str, size: tuple[int, int], *, touch: bool = False, dark: bool = True
    ) -> None:
        self.wire = Wire(address)
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.wire.call(f"{domain}.enable")
        self.wire.call(
            "Emulation.setDeviceMetricsOverride",
            width=size[0], height=size[1], deviceScaleFactor=1, mobile=touch,
        )  # fmt: skip
        if touch:
            self.wire.call("Emulation.setTouchEmulationEnabled", enabled=True)
        self.media(**{"prefers-color-scheme": "dark" if dark else "light"})

    def media(self, **features: str) -> None:
        rows = [{"name": name, "value": value} for name, value in features.items()]
        self.wire.call("Emulation.setEmulatedMedia", features=rows)

    def open(self, url: str) -> None:
        self.wire.call("Page.navigate", url=url)

    def front(self) -> None:
        """Bring the tab to the front: one behind another draws nothing."""
        self.wire.call("Page.bringToFront")

    def reload(self) -> None:
        self.wire.call("Page.reload")

    def run(self, expression: str) -> Any:  # noqa: ANN401 - any JSON value
        """Return the value of a JavaScript expression; promises are awaited."""
        found = self.wire.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True, userGesture=True
        )
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, expression: str, wait_s: float = WAIT_S) -> Any:  # noqa: ANN401 - any JSON value
        """Return the expression's value as soon as it is true; while the page changes it may not be there."""
        until = time.monotonic() + wait_s
        while time.monotonic() < until:
            with suppress(AssertionError):
                value = self.run(expression)
                if value:
                    return value
            # Between two looks the browser works; the page's own events cannot be waited for across a reload.
            self.wire.look(POLL_S)
        raise AssertionError(f"not so within {wait_s} s: {expression}\nthe page says: {self.text()}")

    def text(self, selector: str = "body") -> str:
        return str(self.run(f"document.querySelector({json.dumps(selector)})?.innerText ?? ''"))

    def key(self, key: str, *, repeat: bool = False, up: bool = True) -> None:
        """Press a key; `repeat` is what a held key sends, `up` whether it is let go."""
        code = KEYS.get(key, ord(key.upper()) if len(key) == 1 else 0)
        common: dict[str, Any] = {"key": key, "windowsVirtualKeyCode": code}
        text = {"text": key if key != "Enter" else "\r"} if len(key) == 1 or key == "Enter" else {}
        self.wire.call("Input.dispatchKeyEvent", type="keyDown", autoRepeat=repeat, **common, **text)
        if up:
            self.wire.call("Input.dispatchKeyEvent", type="keyUp", **common)

    def centre(self, selector: str) -> tuple[float, float]:
        box = self.run(
            f"(() => {{ const element = document.querySelector({json.dumps(selector)});"
            " element.scrollIntoView({ block: 'nearest' }); const b = element.getBoundingClientRect();"
            " return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )
        return float(box[0]), float(box[1])

    def click(self, selector: str) -> None:
        x, y = self.centre(selector)
        for kind in ("mousePressed", "mouseReleased"):
            self.wire.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def tap(self, selector: str) -> None:
        x, y = self.centre(selector)
        self.wire.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
        self.wire.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def swipe(self, selector: str, right: float, down: float) -> None:
        x, y = self.centre(selector)
        self.wire.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
        for share in (0.3, 0.7, 1.0):
            point = {"x": x + right * share, "y": y + down * share}
            self.wire.call("Input.dispatchTouchEvent", type="touchMove", touchPoints=[point])
        self.wire.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def network(self, *, on: bool) -> None:
        """Take the network away, or give it back."""
        self.wire.call(
            "Network.emulateNetworkConditions",
            offline=not on, latency=0, downloadThroughput=-1, uploadThroughput=-1,
        )  # fmt: skip

    def screenshot(self, path: Path) -> None:
        path.write_bytes(base64.b64decode(self.wire.call("Page.captureScreenshot", format="png")["data"]))

    def complaints(self) -> list[str]:
        """Return what the browser complained about: exceptions, violations of the content policy, errors."""
        self.run("0")
        found = []
        for event in self.wire.events:
            if event.get("method") == "Runtime.exceptionThrown":
                details = event["params"]["exceptionDetails"]
                found.append(details.get("exception", {}).get("description", details["text"]))
            elif event.get("method") == "Log.entryAdded" and event["params"]["entry"]["level"] == "error":
                found.append(event["params"]["entry"]["text"])
        return found

    def close(self) -> None:
        with suppress(Exception):
            self.wire.call("Page.close")
        self.wire.close()


class Chromium:
    """A running browser; each person has a profile of their own."""

    def __init__(self, address: str) -> None:
        self._address = address
        self.wire = Wire(address)

    def person(self) -> str:
        """Return a fresh profile: nothing kept, nothing shared."""
        return str(self.wire.call("Target.createBrowserContext")["browserContextId"])

    def tab(self, person: str, size: tuple[int, int] = (1280, 800), **options: Any) -> Tab:  # noqa: ANN401
        target = self.wire.call("Target.createTarget", url="about:blank", browserContextId=person)["targetId"]
        base = self._address.partition("/devtools/")[0]
        return Tab(f"{base}/devtools/page/{target}", size, **options)


@contextmanager
def chromium() -> Iterator[Chromium]:
    """Yield a headless browser in a profile folder of its own; it is ended, and the folder with it."""
    path = program()
    assert path is not None
    with ExitStack() as stack:
        folder = Path(
            stack.enter_context(
                tempfile.TemporaryDirectory(prefix="sfid-chromium-", ignore_cleanup_errors=True)
            )
        )
        process = subprocess.Popen(
            [
                path, "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run",
                "--disable-extensions", "--disable-background-networking", "--disable-component-update",
                "--disable-sync", "--disable-dev-shm-usage", "--remote-debugging-port=0",
                f"--user-data-dir={folder}", "about:blank",
            ],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        stack.callback(process.wait, 10)
        stack.callback(process.terminate)
        browser = Chromium(_address(folder / "DevToolsActivePort", process))
        yield browser
        with suppress(Exception):
            browser.wire.call("Browser.close")


def _address(file: Path, process: subprocess.Popen[bytes]) -> str:
    until = time.monotonic() + START_S
    while time.monotonic() < until and process.poll() is None:
        lines = file.read_text().split() if file.exists() else []
        if len(lines) == 2:
            return f"ws://127.0.0.1:{lines[0]}{lines[1]}"
        with suppress(subprocess.TimeoutExpired):
            process.wait(POLL_S)
    raise AssertionError("Chromium did not start")
