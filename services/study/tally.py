"""How many people are where in a study."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

from services.study.records import Course
from sfid_core.study.assignment import orders
from sfid_core.study.definition import Study
from sfid_core.study.flow import Standing, steps_of

UNASSIGNED = "not assigned yet"


@dataclass(frozen=True, slots=True)
class Tally:
    """Counts of people by condition (or order of conditions), and step or standing."""

    study: str
    opened: int
    """Who opened the page."""
    rows: dict[str, Counter[str]]
    """By condition: how many are at which step, or left how."""
    codes: dict[str, str]
    """Completion code of everybody who completed, by pseudonym: what a recruiter pays for."""
    to_erase: tuple[str, ...]
    """Pseudonyms of those who want their answers deleted, as far as bytes of theirs are still there."""

    def document(self) -> dict[str, Any]:
        """Return the counts for JSON."""
        return {
            "study": self.study,
            "opened": self.opened,
            "conditions": {name: dict(counts) for name, counts in self.rows.items()},
            "codes": self.codes,
            "to_erase": list(self.to_erase),
        }

    def lines(self) -> list[str]:
        """Return the counts for a terminal."""
        lines = [f"{self.study}: {self.opened} opened the page"]
        for name, counts in self.rows.items():
            told = ", ".join(f"{count} {where}" for where, count in counts.items() if count)
            lines.append(f"  {name}: {told or 'nobody'}")
        if self.to_erase:
            lines.append(f"  to be erased from the journals: {', '.join(self.to_erase)}")
        return lines


def tally(study: Study, people: dict[str, Course]) -> Tally:
    """Return the counts; each condition (or order) has a row, also where it is empty."""
    names = {order: ", ".join(study.conditions[place].name for place in order) for order in orders(study)}
    steps = steps_of(study)
    places = [*(f"at {step.name}" for step in steps[:-1])]
    places += [standing.value for standing in Standing if standing is not Standing.TAKING_PART]
    rows = {name: Counter(dict.fromkeys(places, 0)) for name in (*names.values(), UNASSIGNED)}
    for course in people.values():
        progress = course.progress
        row = rows[names[progress.order] if progress.order else UNASSIGNED]
        taking = progress.standing is Standing.TAKING_PART
        row[f"at {steps[progress.at].name}" if taking else progress.standing.value] += 1
    rows = {
        name: Counter({where: count for where, count in counts.items() if count})
        for name, counts in rows.items()
        if name != UNASSIGNED or counts.total()
    }
    erase = [name for name, course in people.items() if course.progress.standing is Standing.ERASED]
    codes = {
        name: course.progress.code
        for name, course in people.items()
        if course.progress.standing is Standing.COMPLETED
    }
    return Tally(study.name, len(people), rows, codes, tuple(sorted(erase)))
