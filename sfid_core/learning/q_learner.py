"""`q-learning`: the agent without a teacher, and the core that `sfid` and `reward` build on."""

from collections.abc import Iterable

from sfid_core.chance import stream
from sfid_core.learning.method import Parameters, Verdict
from sfid_core.learning.q_learning import TDErrors, greedy, update
from sfid_core.learning.q_table import QTable
from sfid_core.teaching.answers import Answer, AnswerKind


class QLearner:
    """Greedy tabular Q-learning from the environment's reward (Watkins & Dayan 1992; paper Eq. 1 and 2)."""

    asks: AnswerKind | None = None

    def __init__(self, actions: int, parameters: Parameters, seed: int, session: str) -> None:
        self.table = QTable(actions)
        self._alpha = parameters.alpha
        self._gamma = parameters.gamma
        self._key = stream(seed, "learner", session)

    def choose(self, state: bytes, counter: int) -> int:
        """Return a greedy action, ties at random."""
        return greedy(self.table.values(state), self._key, counter)

    def judge(self, action: int, answers: Iterable[Answer]) -> Verdict:  # noqa: ARG002 - nobody is asked
        """Return silence: this method asks nobody."""
        return Verdict(0.0)

    def learn(self, state: bytes, action: int, reward: float, h: float, next_state: bytes | None) -> TDErrors:
        """Update Q(s, a) by Eq. 4; with h = 0 that is Eq. 2."""
        next_max = 0.0 if next_state is None else max(self.table.values(next_state))
        return update(self.table.row(state), action, reward, h, next_max, self._alpha, self._gamma)
