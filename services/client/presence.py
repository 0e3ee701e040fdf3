"""Whether a teacher is announced: the token that says so, shown and taken back."""

from collections.abc import Callable
from random import Random

from services.runtime.bus import Bus
from services.runtime.roll import RUN_MARK


class OwnPresence:
    """The presence of one teacher, from `show` to `hide`; neither does anything twice.

    Args: key_of: the token's key for a run.  chance: draws what tells this run of the program from others.
    """

    def __init__(self, bus: Bus, key_of: Callable[[str], str], chance: Random) -> None:
        run = chance.randbytes(4).hex()
        self.program = f"services.client{RUN_MARK}{run}"
        """What it calls itself when it joins: by this the learner tells it from others of the name."""
        self.hidden = False
        """Whether somebody else is there under the name, so that this teacher is not asked."""
        self._bus, self._key = bus, key_of(run)
        self._withdraw: Callable[[], None] | None = None
        self._ended = False

    def show(self) -> None:
        """Say that the teacher is there."""
        self.hidden = False
        if self._withdraw is None and not self._ended:
            self._withdraw = self._bus.announce(self._key)

    def hide(self) -> None:
        """Say so no longer: a learner that starts anew takes whoever is announced for whoever taught."""
        self.hidden = True
        withdraw, self._withdraw = self._withdraw, None
        if withdraw is not None:
            withdraw()

    def end(self) -> None:
        """Say so never again."""
        self._ended = True
        self.hide()
