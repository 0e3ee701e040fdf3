"""Who teaches under which name, and which run of a program it is: told by tokens and by joins."""

Place = tuple[str, str]
"""(session, name)."""
RUN_MARK = "#"
"""In what a program calls itself, between its name and what no other run of it has."""


def run_of(program: str) -> str:
    """Return what tells this start of a program from every other; empty where it does not say."""
    return program.partition(RUN_MARK)[2]


class Roll:
    """The tokens shown under each name, and the run that was let in there.

    The token of a run counts for that run alone: one who was sent away takes back theirs, and nobody else is
    gone. A token that names no run counts for whoever is there.

    Args: one_each: whether one run at a time is let in under a name; else every token counts for everybody.
    """

    def __init__(self, *, one_each: bool) -> None:
        self._one_each = one_each
        self._shown: dict[Place, set[str]] = {}
        self._let_in: dict[Place, str] = {}

    def let_in(self, place: Place, run: str) -> None:
        """Remember the run that teaches here from now on; empty: whichever."""
        if self._one_each:
            self._let_in[place] = run

    def has_let_in_another(self, place: Place, run: str) -> bool:
        """Tell whether another run teaches here; False where either does not say which it is."""
        return bool(run) and self._let_in.get(place, "") not in {"", run}

    def show(self, place: Place, run: str) -> bool:
        """Note a token; True when it counts for whoever teaches here."""
        self._shown.setdefault(place, set()).add(run)
        return self._counts(place, run)

    def take_back(self, place: Place, run: str) -> bool:
        """Note that a token is gone; True when whoever taught here is gone with it."""
        shown, counted = self._shown.get(place, set()), self._counts(place, run)
        shown.discard(run)
        if not shown:
            self._shown.pop(place, None)
        if not counted or self.is_here(place):
            return False
        self.forget(place)
        return True

    def is_here(self, place: Place) -> bool:
        """Tell whether a token is shown that counts for whoever teaches here."""
        return any(self._counts(place, run) for run in self._shown.get(place, ()))

    def forget(self, place: Place) -> None:
        """Wait no longer for the run that was let in here."""
        self._let_in.pop(place, None)

    def _counts(self, place: Place, run: str) -> bool:
        return not run or not self.has_let_in_another(place, run)
