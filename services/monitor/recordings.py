"""One session's recording file: scene and curves in one `.rrd`, with a footer, nothing overwritten."""

import logging
from itertools import count
from pathlib import Path
from tempfile import TemporaryFile

import rerun as rr

from services.monitor.blueprint import blueprint
from services.monitor.config import MonitorError
from services.monitor.rows import Rows
from services.monitor.writer import Writer, stream

TICK_S = 0.5
"""What is written together is in the file so much later."""
FLUSH_TIMEOUT_S = 1.0

_LOG = logging.getLogger(__name__)


def check_folder(folder: Path) -> None:
    """Make the folder for recordings and write to it once. Raises MonitorError when that is not possible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        TemporaryFile(dir=folder).close()
    except OSError as error:
        raise _folder_error(folder, error) from None


class Recording:
    """A file that rows are written to until `close`.

    A disk that is full or gone is told once, in one line; the rows that come after are left out, and
    watching goes on.
    """

    __slots__ = ("_failed", "_stream", "_writer", "path")

    def __init__(self, path: Path, session: str, recording_id: str) -> None:
        self.path = path
        self._failed = False
        self._stream = stream(recording_id, TICK_S, send_properties=True)
        self._stream.set_sinks(rr.FileSink(self.path, write_footer=True))
        self._stream.send_recording_name(session)
        self._stream.send_blueprint(blueprint(), make_active=True, make_default=True)
        self._writer = Writer(self._stream)
        self._writer.style_curves()

    def write(self, rows: Rows) -> None:
        """Write pictures and curves to the file."""
        if self._failed:
            return
        try:
            for row in (*rows.scene, *rows.curves):
                self._writer.write(row)
        except (OSError, RuntimeError) as error:
            self._fail(error)

    def close(self) -> bool:
        """Write what is left and the footer; tell whether the file is whole."""
        try:
            self._stream.flush(timeout_sec=FLUSH_TIMEOUT_S)
        except (OSError, RuntimeError) as error:
            self._fail(error)
        self._stream.disconnect()
        return not self._failed

    def _fail(self, error: Exception) -> None:
        if not self._failed:
            reason = " ".join(str(error).split())
            mend = "make room; `sfid export` writes it anew from the journal"
            _LOG.error("%s: the recording ends here (%s): %s", self.path, reason, mend)
        self._failed = True


def new_file(folder: Path, session: str) -> Path:
    """Reserve `<session>.rrd`, or the first of `<session>.2.rrd`, ... that is not there yet.

    Raises: MonitorError when the folder cannot be written.
    """
    try:
        for number in count(1):
            path = folder / (f"{session}.rrd" if number == 1 else f"{session}.{number}.rrd")
            try:
                path.open("xb").close()
            except FileExistsError:
                continue
            return path
    except OSError as error:
        raise _folder_error(folder, error) from None
    raise AssertionError("count() has no end")


def _folder_error(folder: Path, error: OSError) -> MonitorError:
    reason = error.strerror or str(error)
    return MonitorError(f"cannot write recordings to {folder}: {reason}; choose another recording_dir")
