"""Small studies for tests."""

from typing import Any

from sfid_core.session.config import Window, WindowMode
from sfid_core.study.definition import Condition, Consent, Design, Lesson, Question, QuestionKind, Study

LESSON = Lesson("#####\n#@$.#\n#####", "push", "1", 2, Window(WindowMode.UNTIL_ANSWERED))
CONSENT = Consent("1", "You teach an agent for ten minutes.")
QUESTIONS = (
    Question("hand", QuestionKind.CHOICE, "Which hand?", choices=("left", "right")),
    Question("age", QuestionKind.NUMBER, "How old?", required=False, low=18, high=120),
    Question("more", QuestionKind.TEXT, "Anything else?", required=False),
)
LABELS = Condition("labels", "sfid")
REWARDS = Condition("rewards", "reward")


def study(conditions: int = 2, **changes: Any) -> Study:  # noqa: ANN401 - any field
    """Return a study of so many conditions, with practice and effort."""
    more = tuple(Condition(f"more-{number}", "sfid") for number in range(2, conditions))
    fields: dict[str, Any] = {
        "name": "maze",
        "title": "Teach an agent",
        "consent": CONSENT,
        "conditions": (LABELS, REWARDS, *more)[:conditions],
        "teaching": LESSON,
        "practice": LESSON,
    }
    return Study(**(fields | changes))


def within(conditions: int = 2, **changes: Any) -> Study:  # noqa: ANN401 - any field
    """Return the same in which everybody meets every condition."""
    return study(conditions, design=Design.WITHIN, **changes)
