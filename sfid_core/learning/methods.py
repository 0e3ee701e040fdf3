"""The switch: methods by name."""

from collections.abc import Mapping
from typing import Any

from sfid_core.learning.advise import ADVISE, ADVISE_LABELS
from sfid_core.learning.clone import CLONE
from sfid_core.learning.coach import COACH
from sfid_core.learning.dagger import DAGGER
from sfid_core.learning.dpba import DPBA
from sfid_core.learning.guidance import GUIDANCE
from sfid_core.learning.guide import GUIDE
from sfid_core.learning.isabl import ISABL
from sfid_core.learning.marks import MARKS
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import ParameterError, Value, parameters_of
from sfid_core.learning.pies import PIES
from sfid_core.learning.potential import POTENTIAL
from sfid_core.learning.q_learning import Q_LEARNING
from sfid_core.learning.reward import REWARD
from sfid_core.learning.sabl import SABL
from sfid_core.learning.sfid import SFID
from sfid_core.learning.sfid_memory import SFID_MEMORY
from sfid_core.learning.tamer import TAMER
from sfid_core.learning.tamer_rl import TAMER_RL

_METHODS = (
    SFID,
    SFID_MEMORY,
    REWARD,
    Q_LEARNING,
    POTENTIAL,
    PIES,
    DPBA,
    GUIDANCE,
    TAMER,
    TAMER_RL,
    ADVISE,
    ADVISE_LABELS,
    SABL,
    ISABL,
    COACH,
    CLONE,
    DAGGER,
    GUIDE,
    MARKS,
)
METHODS: dict[str, Method] = {method.name: method for method in _METHODS}


def method_named(name: str) -> Method:
    """Return the named method; ParameterError for a name that is not one."""
    if name not in METHODS:
        message = f"unknown method {name!r}: choose one of {', '.join(METHODS)}"
        raise ParameterError(message)
    return METHODS[name]


def method_parameters(name: str, given: Mapping[str, Value]) -> Any:  # noqa: ANN401 - each method has its own
    """Return the named method's parameters with the given ones in place of its defaults.

    Raises: ParameterError for an unknown method, an unknown parameter or a value out of range.
    """
    return parameters_of(method_named(name).parameters, given, f"method {name}")
