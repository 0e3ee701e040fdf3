"""A teacher's program in a room in memory: the client's half of joining, as a test drives it."""

from protocol.keys import Keys
from services.client import Client, Opened, Refused, Update, Welcomed
from services.outbox import Outbox
from services.runtime.memory_bus import MemoryBus
from tests.services.learner.classroom import MS, Classroom


class Program:
    """A client on a bus of its own, which it loses when it is killed."""

    def __init__(
        self, room: Classroom, name: str = "ann", *, token: str | None = None, deployment: str = "local"
    ) -> None:
        self.room, self.bus = room, MemoryBus(room.hub)
        self.client = Client(
            self.bus, Keys(deployment), "s1", name, outbox=Outbox(), clock=room.clock, token=token
        )
        self.client.__enter__()

    def watch(self, milliseconds: int = 0) -> list[Update]:
        """Let some time pass, and return what came of it."""
        found: list[Update] = []
        for _ in range(1 + milliseconds // 50):
            quiet = 0
            while quiet < 2:  # what it asks while nothing is there for it is answered before time goes on
                self.room.settle()
                update = self.client.next(0)
                quiet = quiet + 1 if update is None else 0
                found += [] if update is None else [update]
            self.room.clock.advance(50 * MS)
        return found


def is_refused(program: Program) -> bool:
    """Tell whether it is sent away, again and again."""
    program.watch(2_000)
    return Refused in kinds(program.watch(2_000))


def kinds(updates: list[Update]) -> set[type[Update]]:
    return {type(update) for update in updates} & {Refused, Welcomed, Opened}
