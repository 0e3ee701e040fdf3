"""The switch of `sfid crowd aggregate`: batch and online methods by name."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from sfid_core.crowd.dawid_skene import PRIOR, dawid_skene
from sfid_core.crowd.em import Floats
from sfid_core.crowd.labels import LabelSet
from sfid_core.crowd.majority import majority
from sfid_core.crowd.one_coin import one_coin
from sfid_core.crowd.outcome import Outcome
from sfid_core.crowd.settings import CrowdMethod
from sfid_core.crowd.stream import EVERY_LABEL_COUNTS, stream
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


def aggregate(labels: LabelSet, name: str, prior_labels: float | None = None) -> Aggregated:
    """Apply the named method.

    Args: prior_labels: what the prior of a worker's matrix is worth, in labels a class, 0 to 1000 (online
        from 0.001); None for the method's own.
    Raises: ParameterError for a name that is none, and for a prior outside its range or of a method without
    one.
    """
    if name not in NAMES:
        message = f"crowd method {name!r} is unknown: choose one of {', '.join(NAMES)}"
        raise ParameterError(message)
    method = CrowdMethod(name.removeprefix(ONLINE))
    if prior_labels is not None and method is not CrowdMethod.DAWID_SKENE:
        raise ParameterError(f"{name} has no prior in labels a class: leave it out, or choose dawid-skene")
    if name == CrowdMethod.DAWID_SKENE and prior_labels is not None:
        if not 0 <= prior_labels <= 1000:
            raise ParameterError(f"prior {prior_labels} is outside 0 to 1,000: {PRIOR.labels} is usual")
        return Aggregated(dawid_skene(labels, replace(PRIOR, labels=prior_labels)), None)
    if not name.startswith(ONLINE):
        return Aggregated(BATCH[method](labels), None)
    settings = EVERY_LABEL_COUNTS
    if prior_labels is not None:
        settings = replace(settings, diagonal_prior=prior_labels)
    streamed = stream(labels, method, settings)
    return Aggregated(streamed.outcome, streamed.live)
