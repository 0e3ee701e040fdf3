"""Questions of a crowd about sessions, passed on to the learners who know."""

from contextlib import suppress
from functools import partial

from protocol.codec import DecodeError, encode
from protocol.keys import Keys
from protocol.messages import Refusal
from protocol.session_union import list_query, union_page
from services.runtime.bus import Bus, Reply, Request

TIMEOUT_MS = 5_000
LIST_TIMEOUT_MS = 1_500
"""Less than askers wait: of a learner that hangs there is no reply, and they want those of the others."""


class Relay:
    """Asks the learners of a deployment what others ask."""

    def __init__(self, bus: Bus, learners: Keys) -> None:
        self._bus, self._learners = bus, learners

    def open(self, keys: Keys) -> None:
        """Serve those who use `keys` from now on."""
        self._bus.serve(keys.learner("list"), self._list)
        self._bus.serve(keys.learner("show"), self._show)

    def _show(self, request: Request) -> None:
        hand_back = partial(_hand_back, request)
        self._bus.ask(self._learners.learner("show"), request.payload, hand_back, TIMEOUT_MS)

    def _list(self, request: Request) -> None:
        try:
            leave_out = list_query(request.payload).leave_out
        except DecodeError as error:
            request.reply_error(encode(Refusal(code="malformed", reason=str(error))))
            return
        hand_back = partial(_hand_back_all, request, leave_out)
        self._bus.ask_all(self._learners.learner("list"), request.payload, hand_back, LIST_TIMEOUT_MS)


def _hand_back(request: Request, answer: Reply | None) -> None:
    if answer is not None:
        (request.reply if answer.ok else request.reply_error)(answer.payload)


def _hand_back_all(request: Request, leave_out: int, answers: tuple[Reply, ...]) -> None:
    lists = [answer.payload for answer in answers if answer.ok]
    if len(lists) <= 1:
        _hand_back(request, next((answer for answer in answers if answer.ok or not lists), None))
        return
    with suppress(DecodeError):  # what cannot be read is no answer
        request.reply(encode(union_page(lists, leave_out)))
