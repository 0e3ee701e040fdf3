"""The layout: what must hold of each pane, whatever curves come."""

from collections.abc import Iterator
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from services.monitor.blueprint import blueprint

View = rrb.TimeSeriesView | rrb.TextLogView | rrb.TextDocumentView


def views(part: object) -> Iterator[View]:
    """Return the views of a container, and of those inside it."""
    if isinstance(part, View):
        yield part
    elif isinstance(part, rrb.Container):
        for each in part.contents:
            yield from views(each)


def values(batch: rr.ComponentColumn | rr.ComponentBatchLike | None) -> list[Any]:
    assert batch is not None
    return list(batch.as_arrow_array().to_pylist())


def test_a_legend_is_shown_only_where_no_curve_can_come_below_it() -> None:
    found = [view for view in views(blueprint().root_container) if isinstance(view, rrb.TimeSeriesView)]
    assert len(found) == 11
    shown = 0
    for view in found:
        legend = view.properties["PlotLegend"]
        assert isinstance(legend, rrb.PlotLegend)
        if values(legend.visible) == [True]:
            shown += 1
            assert values(legend.corner) == [rrb.Corner2D.RightBottom.value]
            axis = view.properties["ScalarAxis"]
            assert isinstance(axis, rrb.ScalarAxis)
            ((least, most),) = values(axis.range)
            assert least <= -0.25 * (most - least), "reliabilities are above nothing: the legend is below it"
    assert shown == 1


def test_what_is_listed_says_in_which_order_and_it_is_one() -> None:
    lists = [
        str(view.name)
        for view in views(blueprint().root_container)
        if isinstance(view, rrb.TextLogView) or view.origin == "/episodes"
    ]
    assert lists == ["Events, newest last", "The latest episodes, newest last"]
