"""How the panes are laid out; sent once, because every blueprint that is sent is kept for ever."""

import rerun as rr
import rerun.blueprint as rrb

from services.monitor import curves, policy, scene

BACKGROUND = (11, 13, 18)
LANES_SHOWN = 100
"""Decisions that the lanes of labels show."""


def blueprint() -> rrb.Blueprint:
    """Return the layout: a tab to watch, and one with the episodes as a table."""
    return rrb.Blueprint(
        rrb.Tabs(_live(), _table(), active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="decision", play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def _live() -> rrb.Vertical:
    pictures = rrb.Vertical(
        _picture(scene.ENTITY, "World: agent's move white (red: bumped), teachers' in colour"),
        _picture(policy.ENTITY, "What the agent would do: best action and value, boxes as they stand"),
    )
    plots = rrb.Grid(
        _plot(curves.STEPS, "Steps per episode"),
        _plot(curves.RETURN, "Discounted return per episode", rrb.Corner2D.RightBottom),
        _plot(curves.TD_ERROR, "Mean absolute TD error per episode"),
        _plot(curves.INPUTS, "Teacher inputs per episode"),
        grid_columns=2,
    )
    right = rrb.Vertical(
        plots,
        rrb.Horizontal(
            _plot(
                curves.AGREEMENT,
                "Share of labels that agree with the agent",
                rrb.Corner2D.RightBottom,
                (0.0, 1.05),
            ),
            _lanes(),
        ),
        row_shares=[2, 1],
    )
    events = rrb.TextLogView(
        origin="/events",
        name="Events",
        columns=rrb.TextLogColumns(timeline_columns=["decision"], text_log_columns=["loglevel", "body"]),
    )
    texts = rrb.Horizontal(rrb.TextDocumentView(origin="/now", name="Now"), events, column_shares=[3, 8])
    return rrb.Vertical(
        rrb.Horizontal(pictures, right, column_shares=[5, 8]), texts, row_shares=[5, 1.3], name="Live"
    )


def _picture(entity: str, name: str) -> rrb.Spatial2DView:
    return rrb.Spatial2DView(origin=f"/{entity}", name=name, background=BACKGROUND)


def _plot(
    entity: str,
    name: str,
    corner: rrb.Corner2D = rrb.Corner2D.RightTop,
    span: tuple[float, float] | None = None,
) -> rrb.TimeSeriesView:
    axis = None if span is None else rrb.ScalarAxis(range=span)
    legend = rrb.PlotLegend(corner=corner)
    always = rr.TimeRangeBoundary.infinite()
    # Said in full, because a late viewer otherwise keeps the stretch it saw first.
    whole = rrb.archetypes.TimeAxis(link="Independent", view_range=rr.TimeRange(start=always, end=always))
    return rrb.TimeSeriesView(origin=f"/{entity}", name=name, axis_x=whole, axis_y=axis, plot_legend=legend)


def _lanes() -> rrb.StateTimelineView:
    shown = rr.TimeRange(
        start=rr.TimeRangeBoundary.cursor_relative(seq=-LANES_SHOWN),
        end=rr.TimeRangeBoundary.cursor_relative(seq=2),
    )
    axis = rrb.archetypes.TimeAxis(link="Independent", view_range=shown)
    name = "What each teacher said: blue ←, amber →, pink ↑, green ↓"
    return rrb.StateTimelineView(origin="/teachers", name=name, time_view=axis)


def _table() -> rrb.DataframeView:
    entities = [f"/{entity}" for entity in (curves.STEPS, curves.TD_ERROR, curves.RETURN, curves.INPUTS)]
    query = rrb.archetypes.DataframeQuery(timeline="episode", apply_latest_at=False)
    return rrb.DataframeView(origin="/curves", contents=entities, name="Episodes", query=query)
