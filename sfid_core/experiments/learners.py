"""Methods against teachers: what the learnt policy alone can do after so many episodes, at what cost.

Teachers are simulated (`sfid_core.teaching.personas`); one who is perfect when labelling is perfect
when judging, and so on: what differs between two rows of a column is what the method asks for and what it
makes of that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from sfid_core.experiments.claims import Claim
from sfid_core.experiments.condition import CHECKED, Condition, Results
from sfid_core.experiments.intervals import Resampling
from sfid_core.experiments.orderings import Ordering, Robustness, ordering_claims
from sfid_core.experiments.summary import Arm
from sfid_core.learning.methods import METHODS, method_named
from sfid_core.learning.parameters import ParameterError, Value
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.teaching.personas import persona_named

CHECKPOINTS = (30, 100, 300)
"""Episodes after which the policy is tried; 30 is the founding paper's session."""
PERFECT, NOISY, VERY_NOISY = "oracle", "noisy", "very-noisy"
PRAISING, BLAMING, RARE = "reward-focused", "punishment-focused", "rare"
EXPLORE = 0.1
"""epsilon of those whom no teacher leads."""
DEADLOCK_REWARD = 0.0
"""A deadlock ends the episode and costs nothing else: what there is to learn comes from the goal and from the
teacher. A cost of its own (-10 in sessions) helps every method that learns from rewards."""
STEPS_MAX = 100
"""Step cap of an episode; a session has 200. It decides what being trapped costs, in steps and in answers."""
TEACHERS = (PERFECT, NOISY, VERY_NOISY, PRAISING, BLAMING, RARE)


@dataclass(frozen=True, slots=True)
class Variant:
    """A method with parameters of its own."""

    method: str
    parameters: Mapping[str, Value] = field(default_factory=dict)
    teacher: Mapping[str, Value] = field(default_factory=dict)
    """Habits of its teachers, beside those they have anyway."""


VARIANTS: dict[str, Variant] = {
    "q-learning": Variant("q-learning", {"explore": EXPLORE}),
    "potential": Variant("potential", {"explore": EXPLORE}),
    "potential-distance": Variant("potential", {"form": "distance", "explore": EXPLORE}),
    "reward": Variant("reward"),
    "sfid": Variant("sfid"),
    "sfid-memory": Variant("sfid-memory"),
    "sfid-memory-fast": Variant("sfid-memory", {"alpha": 0.3}),
    "guide": Variant("guide"),
    "guide-judged": Variant("guidance", {"undo": "never"}, {"guidance_width": 1}),
    "tamer": Variant("tamer"),
    "action-biasing": Variant("tamer-rl", {"technique": "action-biasing"}),
    "control-sharing": Variant("tamer-rl", {"technique": "control-sharing", "anneal": 0.995}),
    "control-sharing-switched": Variant(
        "tamer-rl", {"technique": "control-sharing", "anneal": 0.995, "alone": "in-control"}
    ),
    "model-shaping": Variant("tamer-rl", {"technique": "reward-shaping"}),
    "q-augmentation": Variant("tamer-rl", {"technique": "q-augmentation"}),
    "advise": Variant("advise"),
    "sabl": Variant("sabl"),
    "isabl": Variant("isabl"),
    "isabl-held": Variant("isabl", {"explore": 0.0, "update": "episode"}),
    "coach": Variant("coach"),
    "pies": Variant("pies", {"episodes": 99.0}),
    "clone": Variant("clone"),
    "dagger": Variant("dagger"),
}
"""Rows of the table by name; every other method may be named too and has its defaults. `model-shaping` adds
the teacher's model to the reward; `sfid-memory-fast` takes steps of 0.3, which costs it under noise;
`guide-judged` takes the teacher's action and has it judged; `control-sharing-switched` is tried by the action
of whoever is in control more often; `isabl-held` holds its policy for an episode. The advice of `pies` weighs
nothing from the 100th episode on, its last one with the authors' D = 100."""


def total_name(what: str, episodes: int) -> str:
    """Return how a total at a checkpoint is called."""
    return f"{what}_{episodes}"


ORDERINGS: tuple[Ordering | Robustness, ...] = (
    Ordering("coach", "sfid", PERFECT, "success_30"),
    Ordering("sfid", "q-learning", PERFECT, "success_30"),
    Ordering("guide", "sfid", VERY_NOISY, "success_30"),
    Robustness("sfid-memory", "sfid-memory-fast", VERY_NOISY, PERFECT, "success_300"),
    *(Ordering("dagger", other, VERY_NOISY, "success_30") for other in ("sfid", "reward", "tamer", "coach")),
    *(
        Robustness("dagger", other, VERY_NOISY, PERFECT, "success_100")
        for other in ("sfid", "reward", "coach")
    ),
    *(Robustness("sfid", other, VERY_NOISY, PERFECT, "success_30") for other in ("tamer", "isabl", "coach")),
    *(Ordering(other, "reward", PRAISING, "success_300") for other in ("sfid", "tamer", "advise", "pies")),
    Ordering("action-biasing", "model-shaping", PRAISING, "success_100"),
    Ordering("action-biasing", "q-augmentation", PRAISING, "success_300"),
    *(Ordering("sfid", other, BLAMING, "success_30") for other in ("reward", "tamer", "sabl", "coach")),
    *(Ordering("isabl", other, BLAMING, "success_30") for other in ("sabl", "tamer", "reward")),
)
"""Who is robust to noise, to a teacher who only praises, to one who only blames; what choosing comes to."""


def conditions(
    world: WorldSpec, methods: Sequence[str] = tuple(VARIANTS), teachers: Sequence[str] = TEACHERS
) -> list[Condition]:
    """Return a condition for every method and teacher; raises ParameterError for a name that is not known."""
    return [
        Condition(
            teacher,
            SessionConfig("learners", world, variant.method, variant.parameters, CHECKPOINTS[-1]),
            {"teacher": persona_named(teacher, variant.teacher)},
            CHECKPOINTS,
            name,
        )
        for name in methods
        for variant in (variant_named(name),)
        for teacher in teachers
    ]


def variant_named(name: str) -> Variant:
    """Return a row of the table by its name, or a method with its defaults; raises ParameterError."""
    if name in VARIANTS:
        return VARIANTS[name]
    if name not in METHODS:
        names = dict.fromkeys((*VARIANTS, *METHODS))
        message = f"unknown method {name!r}: choose from {', '.join(names)}"
        raise ParameterError(message)
    return Variant(method_named(name).name)


def arm(condition: Condition, results: Results) -> Arm:
    """Return a condition's results: success, inputs and steps at every checkpoint, a number a seed."""
    totals = {
        total_name(what, episodes): results[:, row, place]
        for row, episodes in enumerate(condition.checkpoints)
        for place, what in enumerate(CHECKED)
    }
    return Arm(condition.method, condition.teacher, {}, totals)


def claims(arms: Sequence[Arm], resampling: Resampling) -> tuple[Claim, ...]:
    """Return the orderings among the arms that were run, with intervals that hold all at once."""
    run = {(one.method, one.teacher) for one in arms}
    asked = [one for one in ORDERINGS if _needed(one) <= run]
    return tuple(_spelt(claim) for claim in ordering_claims(arms, asked, resampling))


def _needed(ordering: Ordering | Robustness) -> set[tuple[str, str]]:
    teachers = {ordering.teacher}
    if isinstance(ordering, Robustness):
        teachers.add(ordering.reference)
    return {(method, teacher) for method in (ordering.better, ordering.worse) for teacher in teachers}


def _spelt(claim: Claim) -> Claim:
    text = claim.claim
    for episodes in reversed(CHECKPOINTS):  # success_30 is the beginning of success_300
        text = text.replace(total_name("success", episodes), f"success after {episodes} episodes")
    return replace(claim, claim=text, unit="of the starts")
