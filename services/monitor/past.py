"""What happened before: a session's journal, read page by page from its learner and told again.

One question is open at a time, and each page is folded on the worker's turn, so that what goes on meanwhile
is shown between two pages.
"""

from collections.abc import Callable

from protocol.codec import DecodeError, decode, encode
from protocol.journal import Record
from protocol.messages import JournalRows, RowsQuery
from protocol.retelling import Retelling
from services.monitor.session_view import SessionView
from services.runtime.bus import Reply

Ask = Callable[[bytes], None]


class Past:
    """Tells a session's view what it missed."""

    __slots__ = ("_ask", "_done", "_retelling", "_session", "_view", "rows")

    def __init__(self, session: str, view: SessionView, ask: Ask) -> None:
        self._done = False
        self.rows = 0
        self._session = session
        self._view = view
        self._ask = ask
        self._retelling = Retelling()

    def is_done(self) -> bool:
        """Tell whether there is nothing more to be told, or nobody to ask."""
        return self._done

    def begin(self) -> None:
        """Ask for the first page."""
        self._ask(encode(RowsQuery(session=self._session)))

    def take(self, reply: Reply | None) -> None:
        """Tell a page, then ask for the next one.

        Raises: DecodeError when the page cannot be read; what was told stays, and watching goes on.
        """
        if reply is None or not reply.ok:
            self._end()
            return
        try:
            page = decode(reply.payload, JournalRows)
            for row in page.rows:
                for _, message in self._retelling.tell(Record(row.kind, row.at_ns, row.body)):
                    self._view.retell(message)
        except DecodeError:
            self._end()
            raise
        self.rows += len(page.rows)
        if page.whole:
            self._end()
        else:
            self._ask(encode(RowsQuery(session=self._session, after_seq=page.after_seq)))

    def _end(self) -> None:
        self._done = True
        self._retelling = Retelling()  # gives the table of a long session back
        self._view.past_is_told()
