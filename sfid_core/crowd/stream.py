"""A finished set of labels given to an online aggregate, task after task, as a live crowd would give them."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sfid_core.crowd.em import Floats
from sfid_core.crowd.labels import LabelSet
from sfid_core.crowd.online import OnlineAggregate
from sfid_core.crowd.outcome import Outcome
from sfid_core.crowd.settings import CrowdMethod, CrowdSettings

EVERY_LABEL_COUNTS = CrowdSettings(abstain_below=0.0, influence_cap=1.0)
"""For a set that is judged as a whole: no threshold, and nobody cut short."""


class Streamed(NamedTuple):
    """What one pass over the tasks came to."""

    outcome: Outcome
    """Every task weighed with what was known of the workers at the end."""
    live: Floats
    """(tasks, K): the posteriors as they were concluded, before anything was learnt from the task."""


def stream(labels: LabelSet, method: CrowdMethod, settings: CrowdSettings = EVERY_LABEL_COUNTS) -> Streamed:
    """Conclude each task and learn from it, in the order of their first rows; then look at each again."""
    aggregate = OnlineAggregate(labels.votes.class_count, replace(settings, method=method))
    tasks = _by_task(labels)
    live = []
    for given in tasks:
        live.append(aggregate.conclude(given).posterior)
        aggregate.learn(given)
    posterior = np.array([aggregate.conclude(given).posterior for given in tasks])
    known = [aggregate.reliability(str(worker)) for worker in labels.worker_names]
    reliability = np.array([worker.mean for worker in known])
    error = np.array([worker.standard_error for worker in known])
    return Streamed(Outcome(posterior, reliability, error), np.array(live))


def _by_task(labels: LabelSet) -> list[Mapping[str, int | None]]:
    """Return each task's labels by worker; of several by one worker the last counts."""
    names = [str(worker) for worker in labels.worker_names]
    tasks: list[dict[str, int | None]] = [{} for _ in labels.task_names]
    votes = labels.votes
    rows = zip(votes.tasks.tolist(), votes.workers.tolist(), votes.labels.tolist(), strict=True)
    for task, worker, label in rows:
        tasks[task][names[worker]] = label
    return list(tasks)
