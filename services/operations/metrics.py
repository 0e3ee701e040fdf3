"""Counts of a deployment for Prometheus: asked of its services at each scrape, so that serving costs nothing.

What became of answers is the learner's fold of its journal: the counters go on where they were after a
restart, and their sum is the number of answers in the journal at every moment.
"""

from collections.abc import Callable, Iterable

from prometheus_client import CollectorRegistry, start_http_server
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)
from prometheus_client.registry import Collector

from protocol.messages import LabelTotals
from protocol.status_message import COMMIT_BOUNDS_US
from services.operations.status import Found

WHAT_BECAME = tuple(
    name for name in LabelTotals.__struct_fields__ if name not in {"submitted", "acknowledged"}
)
WHO = ["deployment", "role", "name"]


class Scrape(Collector):
    """Asks how the services do whenever it is scraped. Args: survey: asks them."""

    def __init__(self, survey: Callable[[], list[Found]]) -> None:
        self._survey = survey

    def collect(self) -> Iterable[Metric]:
        """Yield the metrics of this moment."""
        found = self._survey()
        up = GaugeMetricFamily("sfid_ready", "Whether the service answers and can be used.", labels=WHO)
        for one in found:
            up.add_metric(_who(one), float(one.ready))
        yield up
        yield from _gauges(found)
        yield _answers(found)
        yield _refused(found)
        yield _commits(found)


def _who(one: Found) -> list[str]:
    return [one.deployment, one.role, one.name]


def _gauges(found: list[Found]) -> Iterable[Metric]:
    for field, help_ in (
        ("backlog", "Messages that wait for the service's loop."),
        ("sessions", "Sessions, finished ones too."),
        ("running", "Sessions that are not finished."),
        ("teachers", "People present, over all sessions."),
        ("uptime_ms", "Time since the start of the process, in ms."),
    ):
        gauge = GaugeMetricFamily(f"sfid_{field}", help_, labels=WHO)
        for one in found:
            if one.status is not None:
                gauge.add_metric(_who(one), float(getattr(one.status, field)))
        yield gauge


def _answers(found: list[Found]) -> Metric:
    family = CounterMetricFamily(
        "sfid_answers", "Answers in the journal, by what became of them.", labels=[*WHO, "became"]
    )
    for one in found:
        if one.status is not None and one.role == "learner":
            for became in WHAT_BECAME:
                family.add_metric([*_who(one), became], float(getattr(one.status.labels, became)))
    return family


def _refused(found: list[Found]) -> Metric:
    family = CounterMetricFamily(
        "sfid_refused", "Messages refused since the start, by reason.", labels=[*WHO, "reason"]
    )
    for one in found:
        for reason, count in one.status.refused.items() if one.status is not None else ():
            family.add_metric([*_who(one), reason], float(count))
    return family


def _commits(found: list[Found]) -> Metric:
    family = HistogramMetricFamily(
        "sfid_commit_seconds", "Commits of the journal since the start, by how long they took.", labels=WHO
    )
    for one in found:
        if one.status is not None and one.status.commits:
            bounds = [*(f"{bound / 1e6:g}" for bound in COMMIT_BOUNDS_US), "+Inf"]
            total, buckets = 0, []
            for bound, count in zip(bounds, one.status.commits, strict=True):
                total += count
                buckets.append((bound, float(total)))
            family.add_metric(_who(one), buckets, one.status.commit_us / 1e6)
    return family


class Exporter:
    """Serves the metrics at http://HOST:PORT/metrics until `close`. Raises OSError when the port is taken."""

    def __init__(self, host: str, port: int, survey: Callable[[], list[Found]]) -> None:
        registry = CollectorRegistry(auto_describe=False)
        registry.register(Scrape(survey))
        self._server, self._thread = start_http_server(port, host, registry)
        self.port = self._server.server_port

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
