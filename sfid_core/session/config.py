"""What a session is told at its creation; all of it is journaled before the first decision."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from sfid_core.learning.methods import method_parameters
from sfid_core.learning.parameters import ParameterError, Value

SPAN_MS_MAX = 3_600_000
"""An hour: longer than any person looks at one decision, short enough that a deadline stays a deadline."""
EPISODES_MAX = 1_000_000


class WindowMode(Enum):
    """When the window for answers closes."""

    EARLY = "early"
    """As soon as the quorum has answered, at the latest after the span."""
    FULL = "full"
    """After the span, as the founding paper does."""
    UNTIL_ANSWERED = "until-answered"
    """When the quorum has answered, however long it takes."""


@dataclass(frozen=True, slots=True)
class Window:
    """The time given to teachers for one decision."""

    mode: WindowMode = WindowMode.EARLY
    span_ms: int = 2_000
    """Span in ms, 1 to 3,600,000. The paper lets the teacher set it and states no value; 2 s is ours."""
    quorum: int = 0
    """Number of answers that close the window; 0 means every teacher who is present (at least one)."""

    def __post_init__(self) -> None:
        if not 1 <= self.span_ms <= SPAN_MS_MAX:
            message = (
                f"window span {self.span_ms} ms is outside 1 to {SPAN_MS_MAX}: people need 500 to 5000 ms"
            )
            raise ParameterError(message)
        if self.quorum < 0:
            message = f"window quorum {self.quorum} is negative: use 0 for everyone present, or a number"
            raise ParameterError(message)


@dataclass(frozen=True, slots=True)
class WorldSpec:
    """The world that the environment service is asked to run, as text: the learner does not look inside."""

    level: str
    """The level in XSB."""
    level_name: str = "level"
    starts: str = "4"
    """Start distribution: "1" the level's own start, "N" that and N-1 drawn ones, "all" all solvable ones."""
    goal_reward: float = 10.0
    step_reward: float = 0.0
    deadlock_reward: float = -10.0
    steps_max: int = 200
    """Step cap of an episode; a capped episode is cut off, not terminal."""


@dataclass(frozen=True, slots=True)
class SessionConfig:
    """One session: what is taught, by which method, for how long."""

    session: str
    world: WorldSpec
    method: str = "sfid"
    parameters: Mapping[str, Value] = field(default_factory=dict)
    """Parameters of the method that differ from its defaults."""
    episodes: int = 30
    """Number of episodes; the founding paper has 30."""
    seed: int = 0
    window: Window = field(default_factory=Window)
    teachers_min: int = 1
    """Teachers who must have joined before the first decision; 0 lets the agent start alone."""

    def __post_init__(self) -> None:
        method_parameters(self.method, self.parameters)
        if not 1 <= self.episodes <= EPISODES_MAX:
            message = f"episodes {self.episodes} is outside 1 to {EPISODES_MAX}: the founding paper has 30"
            raise ParameterError(message)
        if self.teachers_min < 0:
            message = f"teachers_min {self.teachers_min} is negative: use 0 to start without teachers"
            raise ParameterError(message)

    @property
    def method_parameters(self) -> Any:  # noqa: ANN401 - each method has its own
        """Return all parameters of the method, as its kernels read them."""
        return method_parameters(self.method, self.parameters)
