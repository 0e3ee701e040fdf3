"""A real terminal for a program: keys pressed one by one, the screen read back."""

import re
import subprocess
import time
from pathlib import Path

DEADLINE_S = 30.0
PATIENCE_S = 2.0
"""A key pressed in the very moment a decision appears may be meant for the one before: it is dropped."""


class Terminal:
    """A tmux session of its own server, so that nobody else's is touched."""

    def __init__(self, socket: Path, command: list[str]) -> None:
        self._tmux = ["tmux", "-S", str(socket), "-f", "/dev/null"]
        self._run("new-session", "-d", "-s", "person", "-x", "100", "-y", "30", *command)

    def _run(self, *arguments: str) -> str:
        return subprocess.run([*self._tmux, *arguments], check=True, capture_output=True, text=True).stdout

    def screen(self) -> str:
        return self._run("capture-pane", "-p", "-t", "person")

    def press(self, key: str) -> None:
        self._run("send-keys", "-t", "person", key)

    def wait_for(self, pattern: str, key: str | None = None) -> str:
        """Return the screen as soon as it shows the pattern; press the key again when nothing happens."""
        deadline = time.monotonic() + DEADLINE_S
        again = time.monotonic() + PATIENCE_S
        while True:
            screen = self.screen()
            if re.search(pattern, screen):
                return screen
            assert time.monotonic() < deadline, f"no {pattern!r} on the screen:\n{screen}"
            if key is not None and time.monotonic() > again:
                self.press(key)
                again = time.monotonic() + PATIENCE_S

    def end(self) -> None:
        subprocess.run([*self._tmux, "kill-server"], check=False, capture_output=True)
