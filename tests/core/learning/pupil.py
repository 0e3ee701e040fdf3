"""A learner in a test: one method on named states, taught by answers."""

from collections.abc import Sequence

from sfid_core.learning.kernels import Draws, Learned
from sfid_core.learning.learner import Learner, learner_draws
from sfid_core.learning.methods import method_named, method_parameters
from sfid_core.learning.parameters import Value
from sfid_core.teaching.answers import Answer, AnswerKind
from sfid_core.teaching.merge import merge

LEFT, RIGHT, UP, DOWN = range(4)
S0, S1, S2 = b"s0", b"s1", b"s2"
END = b"end"


def labels(*actions: int) -> list[Answer]:
    return [Answer(AnswerKind.LABEL, action=action) for action in actions]


def rewards(*values: float) -> list[Answer]:
    return [Answer(AnswerKind.REWARD, reward=value) for value in values]


class Pupil(Learner):
    """`do` is one learnt step; a step without `next_state` is the last."""

    def __init__(
        self, method: str, draws: Draws | None = None, actions: int = 4, **parameters: Value
    ) -> None:
        numbers = method_parameters(method, parameters)
        streams = draws or learner_draws(7, "lab")
        super().__init__(method_named(method), numbers, actions, streams, trail_steps=50)
        self.steps = 0
        self.begin(0)

    def do(
        self,
        state: bytes,
        action: int,
        reward: float = 0.0,
        answers: Sequence[Answer] = (),
        next_state: bytes | None = None,
        *,
        delay_ms: float = 0.0,
        distances: tuple[int, int] = (-1, -1),
        span_ms: float = 0.0,
    ) -> Learned:
        learned = self.learn(
            state,
            action,
            reward,
            merge(answers, self.memory.actions, delay_ms),
            END if next_state is None else next_state,
            terminal=next_state is None,
            step=self.steps,
            distances=distances,
            span_ms=span_ms,
        )
        self.steps = 0 if next_state is None else self.steps + 1
        return learned

    def rounded(self, state: bytes) -> list[float]:
        return [round(value, 9) for value in self.values(state)]
