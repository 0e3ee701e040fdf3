"""The switch of `sfid crowd aggregate`: batch and online methods by name."""

from collections.abc import Callable
from typing import NamedTuple

from sfid_core.crowd.dawid_skene import dawid_skene
from sfid_core.crowd.em import Floats
from sfid_core.crowd.labels import LabelSet
from sfid_core.crowd.majority import majority
from sfid_core.crowd.one_coin import one_coin
from sfid_core.crowd.outcome import Outcome
from sfid_core.crowd.settings import CrowdMethod
from sfid_core.crowd.stream import stream
from sfid_core.crowd.weighted import weighted_majority
from sfid_core.learning.parameters import ParameterError

BATCH: dict[CrowdMethod, Callable[[LabelSet], Outcome]] = {
    CrowdMethod.MAJORITY: majority,
    CrowdMethod.WEIGHTED: weighted_majority,
    CrowdMethod.ONE_COIN: one_coin,
    CrowdMethod.DAWID_SKENE: dawid_skene,
}
ONLINE = "online-"
NAMES = (*BATCH, *(f"{ONLINE}{method}" for method in BATCH))


class Aggregated(NamedTuple):
    """What a method makes of a set; `live` is None for a batch method."""

    outcome: Outcome
    live: Floats | None
    """(tasks, K): the posteriors as they were concluded one by one."""


def aggregate(labels: LabelSet, name: str) -> Aggregated:
    """Apply the named method. Raises: ParameterError for a name that is none."""
    if name not in NAMES:
        message = f"crowd method {name!r} is unknown: choose one of {', '.join(NAMES)}"
        raise ParameterError(message)
    if not name.startswith(ONLINE):
        return Aggregated(BATCH[CrowdMethod(name)](labels), None)
    streamed = stream(labels, CrowdMethod(name.removeprefix(ONLINE)))
    return Aggregated(streamed.outcome, streamed.live)
