"""The common interface of all methods: parameters, kernels, and what is asked of teachers."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sfid_core.learning.kernels import (
    Draws,
    Evidence,
    Learned,
    Memory,
    Transition,
    choose_first_block,
    keep_action,
    keep_step,
    nothing,
    prefer,
)
from sfid_core.teaching.answers import AnswerKind

Numbers = Any
"""The method's own NamedTuple of parameters; every one of them has `gamma`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """One row of the table of methods. All kernels are pure but for the memory, which they may write."""

    name: str
    summary: str
    """One line: what it is."""
    source: str
    """Paper and equation."""
    parameters: type[Any]
    """A NamedTuple of Annotated numbers; its defaults are those of the source."""
    learn: Callable[[Memory, Numbers, Transition, Evidence], Learned]
    """Learn from one executed step and what the teachers said about it."""
    choose: Callable[[Memory, Numbers, Draws, int, int], int] = choose_first_block
    """(.., state, decision) -> the action the agent would take."""
    settle: Callable[[Memory, Numbers, Draws, int, int, Evidence, int], int] = keep_action
    """(.., state, action, evidence, decision) -> the action it does take, once teachers have answered."""
    prefer: Callable[[Memory, Numbers, int, int], float] = prefer
    """(.., state, action) -> how much the learnt policy prefers an action, the teacher gone."""
    begin: Callable[[Memory, Numbers, int], None] = nothing
    """(.., episode) -> anneal, forget traces."""
    asks_before: AnswerKind | None = None
    """What teachers are asked in the frozen state before the action: LABEL or GUIDANCE."""
    asks_after: AnswerKind | None = None
    """What teachers are asked after they saw the action: REWARD or MISTAKE."""
    undo: Callable[[Numbers, Evidence], int] = keep_step
    """(.., evidence) -> 1 where the environment shall take the step back, which is not learnt from."""
    may_undo: bool = False
    """Whether teachers are offered to take the step back, beside what is asked after it."""
    blocks: int = 1
    """Numbers a state and action."""
    scalars: int = 0
    """Numbers of `Memory.scalars`."""
    trail: int = 0
    """Numbers a step in `Memory.trail`; 0 for a method that looks at one step alone."""

    @property
    def asks(self) -> tuple[AnswerKind, ...]:
        """What teachers are asked, before and after the action; empty where nobody is asked."""
        return tuple(kind for kind in (self.asks_before, self.asks_after) if kind is not None)

    def width(self, actions: int) -> int:
        """Return the numbers a state takes."""
        return self.blocks * actions + 1
