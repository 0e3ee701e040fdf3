"""How many teachers of which quality an agent needs, and what members who answer at random cost it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256

import numpy as np
import numpy.typing as npt

from sfid_core.crowd.settings import CrowdSettings
from sfid_core.experiments.claims import SEEDS_MIN, Claim
from sfid_core.experiments.comparison import compare
from sfid_core.experiments.condition import SEEDS_AT_ONCE, Results
from sfid_core.experiments.crowd_lane import MEASURED, CrowdBatch
from sfid_core.experiments.intervals import Resampling
from sfid_core.experiments.summary import Arm
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.teaching.crowd_mix import WorkerKind, parse_mix

EPISODES = 30
"""The founding paper's session."""
SIZES = (1, 2, 3, 5, 7, 10, 14, 20)
"""Members who look at the state, in the sweep."""
QUALITIES = {"60 % right": "careless", "80 % right": "good", "95 % right": "good@0.95"}
"""Members of the sweep by how they are called: the probability that they are right."""
RANDOM_SHARE = 0.3
"""Share of the whole crowd that answers at random, in the sweep's second half and in the claim."""
SHARE_STEP = 1e-9
"""Two shares of members that differ by less are the same."""
COST_MAX = 0.05
"""What members who answer at random may cost, as a share of starts solved after all episodes."""


@dataclass(frozen=True, slots=True)
class CrowdCondition:
    """One crowd over seeds, as `Condition` is one set of teachers."""

    mix: str
    """As `parse_mix` reads it."""
    world: WorldSpec
    weighing: CrowdSettings = field(default_factory=CrowdSettings)
    solver: bool = True
    """Whether naming another optimal action costs no reliability, as in a live aggregator."""
    quality: str = ""
    """How those who look are called, where the condition is part of a sweep."""
    size: int = 0
    """How many of them look, where the condition is part of a sweep."""
    episodes: int = EPISODES
    rows: int = 1
    """Rows a seed of the results: float64 [seeds, 1, len(MEASURED)]."""

    @property
    def config(self) -> SessionConfig:
        """Return the session that the crowd teaches; every seed takes the place of its own."""
        return SessionConfig("crowd", self.world, "sfid", episodes=self.episodes)

    @property
    def digest(self) -> str:
        """Return the hex SHA-256 of everything but the seed that the results depend on."""
        told = ("crowd", self.config, parse_mix(self.mix), self.weighing, self.solver)
        return sha256(repr(told).encode()).hexdigest()

    def seeds_at_once(self, *, fast: bool) -> int:  # noqa: ARG002 - as `Condition.seeds_at_once`
        """Return how many seeds are best run, kept and counted together."""
        return SEEDS_AT_ONCE

    def batch(self, *, fast: bool | None = None) -> CrowdBatch:  # noqa: ARG002 - as `Condition.batch`
        """Return the condition, ready to run, always as Python; raises ParameterError, LevelError."""
        return CrowdBatch(self.config, parse_mix(self.mix), self.weighing, solver=self.solver)

    def run(self, batch: CrowdBatch, seeds: Sequence[int]) -> Results:
        """Return the results of some seeds; `batch` is the condition's."""
        return np.array([[batch.run(seed)] for seed in seeds], dtype=np.float64)


# --- what is compared ---


def sweep(
    world: WorldSpec, weighing: CrowdSettings, sizes: Sequence[int] = SIZES, *, solver: bool = True
) -> list[CrowdCondition]:
    """Return crowds of every size and quality, each alone and with members who answer at random."""
    return [
        CrowdCondition(mix, world, weighing, solver, quality, size)
        for quality, kind in QUALITIES.items()
        for size in sizes
        for mix in (f"{kind}:{size}", f"{kind}:{size},random:{beside(size)}")
    ]


def beside(size: int) -> int:
    """Return how many who answer at random stand beside so many who look, 1 or more."""
    return max(1, round(size * RANDOM_SHARE / (1 - RANDOM_SHARE)))


def compared(
    mixes: Sequence[str], world: WorldSpec, weighing: CrowdSettings, *, solver: bool = True
) -> list[CrowdCondition]:
    """Return these crowds, and each of them without its random members; raises ParameterError."""
    wanted = dict.fromkeys(spelt for mix in mixes for spelt in (tidy(mix), without_random(mix)) if spelt)
    return [CrowdCondition(mix, world, weighing, solver) for mix in wanted]


def tidy(mix: str) -> str:
    """Return a mix with its parts parted by a comma alone; raises ParameterError."""
    parse_mix(mix)
    return ",".join(part.strip() for part in mix.split(","))


def without_random(mix: str) -> str:
    """Return the mix without the members who answer at random; empty where nobody is left."""
    parts = tidy(mix).split(",")
    return ",".join(part for part in parts if part.partition(":")[0] != WorkerKind.RANDOM)


def arm(condition: CrowdCondition, results: Results) -> Arm:
    """Return a condition's results: `MEASURED`, a number a seed."""
    totals = {name: results[:, 0, place] for place, name in enumerate(MEASURED)}
    return Arm(condition.weighing.method.value, condition.mix, {}, totals)


def claims(arms: Sequence[Arm], resampling: Resampling, share: float | None = None) -> tuple[Claim, ...]:
    """Return, for every crowd that was run with and without random members, what they cost.

    Each holds where the whole interval of the difference, seed by seed, lies above -`COST_MAX`; a crowd may
    also be better with them. The intervals hold all at once.

    Args: share: tell only of crowds of whom so many answer at random; small ones cannot have just as many.
    Raises: ExperimentError.
    """
    found = {one.teacher: one.totals["success"] for one in arms}
    pairs = [(mix, plain) for mix in found for plain in (without_random(mix),) if plain != mix]
    told = [
        (mix, plain)
        for mix, plain in pairs
        if plain in found and (share is None or abs(random_share(mix) - share) < SHARE_STEP)
    ]
    at_once = resampling.simultaneous(len(told))
    return tuple(_costs_little(*pair, found, at_once) for pair in told)


def _costs_little(
    mix: str, plain: str, found: Mapping[str, npt.NDArray[np.float64]], resampling: Resampling
) -> Claim:
    difference = compare(found[mix], found[plain], resampling)
    beside_them = f"{random_share(mix):.0%} random members ({mix})"
    return Claim(
        f"{plain} solves at most {100 * COST_MAX:g} points fewer starts with {beside_them}",
        difference.ci.lo > -COST_MAX and difference.n_seeds >= SEEDS_MIN,
        difference.difference,
        difference.ci,
        resampling.level,
        difference.n_seeds,
        margin=COST_MAX,
        cohen_dz=difference.cohen_dz,
        superiority=difference.superiority,
        unit="of the starts",
    )


def random_share(mix: str) -> float:
    """Return the share of the members who answer at random; raises ParameterError."""
    workers = parse_mix(mix)
    return sum(worker.kind is WorkerKind.RANDOM for worker in workers) / len(workers)
