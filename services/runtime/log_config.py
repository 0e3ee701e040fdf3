"""How processes log: lines for people or JSON for programs, with ids that join one process's to another's.

Whoever starts a process chooses for all that it starts. A line about an answer carries `session`, `decision`
and `answer_id`: the same in the log of its teacher, in that of the learner, and in the journal (`sfid said`).
"""

import json
import logging
import os
import sys
import time
from enum import Enum
from typing import Any

VARIABLE = "SFID_LOG_FORMAT"
LEVEL_VARIABLE = "SFID_LOG_LEVEL"
_ABOUT = "sfid_about"


class LogFormat(Enum):
    """How a line of the log is written."""

    TEXT = "text"
    JSON = "json"


class LogLevel(Enum):
    """From which importance on a line is written; at `debug`, one and more for every answer."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


def choose(format_: LogFormat | None, level: LogLevel | None = None) -> None:
    """Have this process, and those that it starts, log in this format and from this level on."""
    if format_ is not None:
        os.environ[VARIABLE] = format_.value
    if level is not None:
        os.environ[LEVEL_VARIABLE] = level.value


def chosen() -> LogFormat:
    """Return the format that was chosen; text when none was, or none that is known."""
    try:
        return LogFormat(os.environ.get(VARIABLE, LogFormat.TEXT.value))
    except ValueError:
        return LogFormat.TEXT


def chosen_level() -> int:
    """Return the level that was chosen, as a number of `logging`; INFO when none that is known was."""
    try:
        level = LogLevel(os.environ.get(LEVEL_VARIABLE, LogLevel.INFO.value))
    except ValueError:
        level = LogLevel.INFO
    return logging.getLevelNamesMapping()[level.name]


def about(**ids: str | int | bytes) -> dict[str, dict[str, str | int]]:
    """Return what `extra` of a log call takes, so that the line carries these ids; bytes are shown as hex."""
    return {_ABOUT: {key: value.hex() if isinstance(value, bytes) else value for key, value in ids.items()}}


def configure(role: str, *, verbose: bool = False) -> None:
    """Log to stderr, one line an event, in the chosen format: UTC time, level, role, process, text, ids."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Lines(role) if chosen() is LogFormat.TEXT else _Documents(role))
    logging.basicConfig(handlers=[handler], level=logging.DEBUG if verbose else chosen_level())


class _Lines(logging.Formatter):
    """For people."""

    def __init__(self, role: str) -> None:
        line = f"%(asctime)s.%(msecs)03dZ %(levelname)-7s {role}[%(process)d] %(message)s"
        super().__init__(line, "%Y-%m-%dT%H:%M:%S")
        self.converter = time.gmtime

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - the library's name
        ids = "".join(f" {key}={value}" for key, value in _ids(record).items())
        return super().formatMessage(record) + ids


class _Documents(logging.Formatter):
    """For programs: one JSON document a line."""

    def __init__(self, role: str) -> None:
        super().__init__()
        self._role = role

    def format(self, record: logging.LogRecord) -> str:
        seconds = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        document: dict[str, Any] = {
            "at": f"{seconds}.{int(record.msecs):03d}Z",
            "level": record.levelname.lower(),
            "role": self._role,
            "pid": record.process,
            "logger": record.name,
            "message": record.getMessage(),
            **_ids(record),
        }
        if record.exc_info:
            document["exception"] = self.formatException(record.exc_info)
        return json.dumps(document, ensure_ascii=False)


def _ids(record: logging.LogRecord) -> dict[str, str | int]:
    found: dict[str, str | int] = getattr(record, _ABOUT, {})
    return found
