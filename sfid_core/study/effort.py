"""The effort questionnaire: six scales after the NASA Task Load Index, scored raw.

Source: Hart & Staveland 1988 (the six dimensions; scales from 0 to 100 in steps of 5); Hart 2006 (the raw
score, the plain mean of the six, without weights). The wording of the questions is ours.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from sfid_core.study.errors import NotNow

LOW, HIGH, STEP = 0, 100, 5


@dataclass(frozen=True, slots=True)
class Scale:
    """One dimension and how it is asked for."""

    name: str
    dimension: str
    question: str
    low: str = "very low"
    high: str = "very high"


SCALES = (
    Scale("mental", "Mental demand", "How much did you have to think, decide, remember and look?"),
    Scale("physical", "Physical demand", "How much did your hands, eyes or body have to do?"),
    Scale("temporal", "Temporal demand", "How rushed did you feel by the pace at which you were asked?"),
    Scale(
        "performance", "Performance", "How well did you do what you set out to do?", "perfectly", "not at all"
    ),
    Scale("effort", "Effort", "How hard did you have to work to do as well as you did?"),
    Scale("frustration", "Frustration", "How annoyed, discouraged, tense or unsure of yourself were you?"),
)


def checked_ratings(ratings: Sequence[float]) -> tuple[int, ...]:
    """Return the six ratings in the order of SCALES; raises NotNow where one is off its scale."""
    if len(ratings) != len(SCALES):
        raise NotNow(f"{len(ratings)} ratings: the questionnaire has {len(SCALES)}")
    for scale, rating in zip(SCALES, ratings, strict=True):
        if not (LOW <= rating <= HIGH and rating % STEP == 0):
            raise NotNow(
                f"{scale.dimension} {rating:g} is not on its scale: {LOW} to {HIGH} in steps of {STEP}"
            )
    return tuple(int(rating) for rating in ratings)


def raw_score(ratings: Sequence[int]) -> float:
    """Return the raw score of six ratings, 0 (no effort at all) to 100."""
    return sum(checked_ratings(ratings)) / len(SCALES)
