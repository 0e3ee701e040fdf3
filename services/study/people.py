"""Who the pseudonyms are at their recruiter: one file, for its owner's eyes only, apart from all answers."""

import json
import os
from collections.abc import Mapping
from pathlib import Path

import msgspec

from sfid_core.study.errors import StudyError

NAME = "people.json"


class People:
    """Pseudonyms and the parameters they came with; every change is on the disk before the call returns."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / NAME
        self._known: dict[str, dict[str, str]] = {}
        try:
            self._known = msgspec.json.decode(self._path.read_bytes(), type=dict[str, dict[str, str]])
        except FileNotFoundError:
            pass
        except msgspec.DecodeError as error:
            raise StudyError(f"{self._path}: {error}: restore it from a backup, or move it away") from None

    def of(self, pseudonym: str) -> Mapping[str, str]:
        """Return the parameters that a person came with; empty when there were none."""
        return self._known.get(pseudonym, {})

    def owner(self, parameter: str, value: str) -> str | None:
        """Return the pseudonym of whoever came with this value, None when nobody did."""
        return next((name for name, known in self._known.items() if known.get(parameter) == value), None)

    def note(self, pseudonym: str, parameters: Mapping[str, str]) -> None:
        """Keep what a person came with. Raises OSError; nothing is kept then."""
        self._write(self._known | {pseudonym: dict(parameters)})

    def forget(self, pseudonym: str) -> None:
        """Delete what is known of a person. Raises OSError."""
        if pseudonym in self._known:
            self._write({name: known for name, known in self._known.items() if name != pseudonym})

    def _write(self, known: dict[str, dict[str, str]]) -> None:
        part = self._path.with_suffix(".part")
        handle = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(handle, "wb") as file:
            os.fchmod(file.fileno(), 0o600)
            file.write(json.dumps(known, indent=1).encode())
            file.flush()
            os.fsync(file.fileno())
        part.replace(self._path)
        folder = os.open(self._path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
        self._known = known
