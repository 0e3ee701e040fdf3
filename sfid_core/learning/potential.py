"""`potential`: potential-based shaping of the environment's reward (Ng, Harada & Russell 1999)."""

from typing import Annotated, NamedTuple

from sfid_core.compiled import kernel
from sfid_core.learning.choices import choose_explored
from sfid_core.learning.kernels import Evidence, Learned, Memory, Transition, best
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import ALPHA, GAMMA, RATE, Choice, Range

VALUE = 0


class PotentialParameters(NamedTuple):
    """Parameters of potential-based shaping."""

    alpha: Annotated[float, ALPHA] = 0.1
    """Step size."""
    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor, of the potential too: another one would change which policy is best."""
    form: Annotated[int, Choice(("value", "distance"))] = 0
    """The potential of a state: its value under the optimal policy where the goal alone pays (value), or
    minus its steps from solved (distance; in Sokoban worse than none)."""
    scale: Annotated[float, Range(-1000, 1000)] = 0.9
    """Factor on the potential. At 1 the best actions come out at 0, as good as untried ones; 0.9 (ours)
    leaves them above."""
    goal_reward: Annotated[float, Range(0, 1e6, unit="reward")] = 10.0
    """What the world pays for solving, for the form `value`."""
    explore: Annotated[float, RATE] = 0.1
    """epsilon: probability of a random action; 0.1 in Ng's grids (from memory, unverified)."""


@kernel
def potential(p: PotentialParameters, distance: int) -> float:
    """Return the potential of a state `distance` steps from solved; 0 where it is solved or nobody knows.

    value (0): scale * goal_reward * gamma**(distance - 1), the value of the state under the optimal policy
    of a world that pays for nothing else. distance (1): -scale * distance, for comparison: in Sokoban it is
    worse than none.
    """
    if distance <= 0:
        return 0.0
    if p.form != VALUE:
        return -p.scale * distance
    phi = p.scale * p.goal_reward
    for _ in range(distance - 1):  # ** would not have the same bits compiled
        phi *= p.gamma
    return phi


@kernel
def learn(m: Memory, p: PotentialParameters, t: Transition, e: Evidence) -> Learned:  # noqa: ARG001 - asks nobody
    """Move Q(s, a) by the TD error of r + F, F = gamma * Phi(s') - Phi(s) and Phi = 0 after the end.

    Where the distance of either state is unknown, F is 0.
    """
    at = t.state * m.width
    ahead = 0.0 if t.terminal else best(m, t.next_state)
    environment = t.reward + p.gamma * ahead - m.values[at + t.action]
    shaped = environment
    if t.distance >= 0 and (t.terminal or t.next_distance >= 0):
        after = 0.0 if t.terminal else potential(p, t.next_distance)
        shaped += p.gamma * after - potential(p, t.distance)
    m.values[at + t.action] += p.alpha * shaped
    m.values[at + m.width - 1] += 1.0
    return Learned(environment, shaped, 0.0)


POTENTIAL = Method(
    name="potential",
    summary="no teacher: Q-learning with a potential of the fewest steps to solved",
    source="Ng, Harada & Russell 1999; the potential in units of the optimal value is ours",
    parameters=PotentialParameters,
    learn=learn,
    choose=choose_explored,
)
