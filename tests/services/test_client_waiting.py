"""What a script that teaches is told while its session is not there."""

import logging
from pathlib import Path

import pytest

from protocol.codec import encode
from protocol.messages import Refusal
from services.client import Connection, Opened, Refused, Teaching, TeachingError, Update, join
from services.client.client import Client
from services.client.waiting import PATIENCE_NS, Waiting
from services.outbox import Outbox
from services.runtime.bus import Request
from services.runtime.clock import ManualClock
from services.runtime.memory_bus import MemoryBus, MemoryHub
from services.runtime.secret import SecretError
from tests.services.linked import tls_endpoint
from tests.services.teachers.fake_learner import KEYS, decision

NOBODY = Connection(connected=False, detail="no learner answers for session 'maez' yet")
SECOND_NS = 1_000_000_000


def told(caplog: pytest.LogCaptureFixture, *updates: Update | None) -> list[str]:
    """What is logged where these come, a second apart."""
    clock = ManualClock(7)
    waiting = Waiting("maez", clock)
    with caplog.at_level(logging.INFO, logger="sfid.client"):
        for update in updates:
            clock.advance(SECOND_NS)
            waiting.note(update)
    return caplog.messages


def test_a_session_that_does_not_come_is_told_once_after_three_seconds_with_the_mend(
    caplog: pytest.LogCaptureFixture,
) -> None:
    assert PATIENCE_NS == 3 * SECOND_NS
    assert told(caplog, NOBODY, NOBODY) == []
    (line,) = told(caplog, *[NOBODY] * 9)
    assert line == (
        "session maez: still waiting: no learner answers for session 'maez' yet "
        "(`sfid session list` shows what sessions there are)"
    )


def test_what_the_learner_says_of_a_session_it_has_not_is_told_as_it_is(
    caplog: pytest.LogCaptureFixture,
) -> None:
    reason = "no session maez here: `sfid session list` shows what there is"
    unknown = Refused("no-session", reason, final=False)
    assert told(caplog, *[unknown] * 5, Opened(decision(), 0), None) == [
        f"session maez: still waiting: {reason}",
        "session maez: joined",
    ]


def test_a_session_that_is_there_is_not_spoken_of_however_long_nothing_happens(
    caplog: pytest.LogCaptureFixture,
) -> None:
    assert told(caplog, NOBODY, Opened(decision(), 0), *[None] * 9) == []


class _Late(ManualClock):
    """A clock that moves on by a second at each look."""

    def now_ns(self) -> int:
        self.advance(SECOND_NS)
        return super().now_ns()


def test_the_loop_over_decisions_tells_it(caplog: pytest.LogCaptureFixture) -> None:
    clock = ManualClock(1)
    hub = MemoryHub(clock, inline=True)
    client = Client(MemoryBus(hub), KEYS, "maez", "ann", outbox=Outbox(), clock=_Late())
    server, asked = MemoryBus(hub), list[bytes]()

    def refuse_at_last(request: Request) -> None:
        asked.append(b"")
        why = "no session maez here"
        refusal = Refusal(code="busy", reason=why) if len(asked) < 6 else Refusal(code="denied", reason=why)
        request.reply_error(encode(refusal))

    server.serve(KEYS.join("maez"), refuse_at_last)
    with client, caplog.at_level(logging.INFO, logger="sfid.client"), pytest.raises(TeachingError):
        list(Teaching(client, _Late()).decisions())
    assert [line.partition(" (")[0] for line in caplog.messages] == [
        "session maez: still waiting: no session maez here"
    ]


def test_paths_may_be_texts(tmp_path: Path) -> None:
    box = tmp_path / "box.sqlite"
    with (
        pytest.raises(SecretError, match=str(tmp_path)),
        join(tls_endpoint(), "s1", "ann", outbox=str(box), access=str(tmp_path)),
    ):
        pass
    assert box.is_file()
