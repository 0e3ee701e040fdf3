"""What a router says of its links: that they stand, do not yet, do no longer, each once."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from services.router import RouterConfig, free_endpoint
from services.router_links import LOOKS, LinkLog
from tests.contract.router_process import router_process
from tests.services.cli.command_line import wait_for
from tests.services.linked import routing

LAB, OTHER = "tls/192.0.2.7:7447", "tls/192.0.2.8:7447"
NOT_YET = f"no link to {LAB} yet, trying: "


def test_each_change_of_a_link_is_said_once() -> None:
    log = LinkLog([LAB])
    looks: list[dict[str, bool]] = [{}, {}, {"a": True}, {"a": True}, {}, {}, {"a": True}]
    said = [log.line(look) for look in looks]
    first = said.pop(0)
    assert first is not None
    assert first.startswith(NOT_YET)
    lost = f"link to {LAB} lost, trying to reach it again"
    assert said == [None, f"linked with {LAB}", None, lost, None, f"linked with {LAB}"]


def test_of_several_links_it_says_how_many_stand() -> None:
    log = LinkLog([LAB, OTHER])
    assert [log.line(look) for look in ({"a": True}, {"a": True, "b": True}, {"b": True})] == [
        f"linked with 1 of {LAB}, {OTHER}",
        f"linked with {LAB}, {OTHER}",
        f"linked with 1 of {LAB}, {OTHER}",
    ]


def test_a_router_that_stands_and_does_not_answer_is_told_from_one_that_does() -> None:
    log = LinkLog([LAB])
    said = [log.line({"a": False}) for _ in range(LOOKS + 1)]
    silent = f"linked with {LAB}, but not every one there answers: zenohd never does"
    assert said == [None] * (LOOKS - 1) + [silent, None]
    assert log.line({"a": True}) == f"linked with {LAB}"


@contextmanager
def _said(caplog: pytest.LogCaptureFixture, begins: str) -> Iterator[None]:
    yield
    wait_for(begins, lambda: any(line.startswith(begins) for line in caplog.messages))


@pytest.mark.real
def test_an_edge_says_that_its_link_is_not_there_yet_then_stands_then_is_lost(
    caplog: pytest.LogCaptureFixture,
) -> None:
    lab, edge = free_endpoint(), free_endpoint()
    with caplog.at_level(logging.INFO, logger="sfid.router"), routing(RouterConfig(edge, connect=(lab,))):
        with _said(caplog, f"no link to {lab} yet"):
            pass
        with router_process(lab), _said(caplog, f"linked with {lab}"):
            pass
        with _said(caplog, f"link to {lab} lost"):
            pass
    assert len([line for line in caplog.messages if lab in line]) == 3
