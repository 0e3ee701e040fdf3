"""How the panes are laid out; sent once, because every blueprint that is sent is kept for ever."""

import rerun as rr
import rerun.blueprint as rrb

from services.monitor import curves, doubt_pictures, overview, policy, scene
from services.monitor.status import EPISODES, NOW

BACKGROUND = (11, 13, 18)
LANES_SHOWN = 100
"""Steps that the lanes of labels show."""


def blueprint(active_tab: int = 0) -> rrb.Blueprint:
    """Return the layout: to watch, what teachers said, all sessions, and the episodes as a table.

    Args: active_tab: number of the tab that is in front, from 0.
    """
    return rrb.Blueprint(
        rrb.Tabs(_live(), _teachers(), _sessions(), _table(), active_tab=active_tab),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="step", play_state="following"),
        auto_layout=False,
        auto_views=False,
    )


def _live() -> rrb.Vertical:
    pictures = rrb.Vertical(
        _picture(scene.ENTITY, "World · white: the agent's move (red: blocked) · coloured: teachers"),
        _picture(policy.ENTITY, "What the agent would do · arrow: best move · bright: high value"),
    )
    plots = rrb.Grid(
        _plot(curves.STEPS, "Steps of each episode · across: timeline set below"),
        _plot(curves.RETURN, "Discounted return of each episode", rrb.Corner2D.RightBottom),
        _plot(curves.TD_ERROR, "Mean absolute TD error of each episode"),
        _plot(curves.INPUTS, "Teacher inputs of each episode"),
        _plot(
            curves.AGREEMENT,
            "Share of labels that agree with the agent",
            rrb.Corner2D.RightBottom,
            (0.0, 1.05),
        ),
        _reliability(),
        grid_columns=2,
    )
    texts = rrb.Horizontal(
        rrb.TextDocumentView(origin=f"/{NOW}", name="Now"), _events(), _lanes(), column_shares=[3, 5, 6]
    )
    return rrb.Vertical(
        rrb.Horizontal(pictures, plots, column_shares=[5, 8]), texts, row_shares=[4.6, 1.4], name="Live"
    )


def _teachers() -> rrb.Horizontal:
    left = rrb.Vertical(
        _picture(doubt_pictures.CONFLICTS, "Where teachers disagree · dark: never · bright: most often"),
        _reliability(),
    )
    right = rrb.Vertical(
        _picture(
            doubt_pictures.STATES,
            "States likely to carry an instruction bug · below each: how often which move was named",
        ),
        rrb.Horizontal(
            rrb.TextDocumentView(origin=f"/{doubt_pictures.LIST}", name="Why to look at these states again"),
            _lanes(),
            column_shares=[3, 2],
        ),
        row_shares=[9, 5],
    )
    return rrb.Horizontal(left, right, column_shares=[4, 7], name="Teachers")


def _sessions() -> rrb.Vertical:
    return rrb.Vertical(
        _picture(overview.ENTITY, "All sessions · red: somebody should look after it"), name="All sessions"
    )


def _events() -> rrb.TextLogView:
    return rrb.TextLogView(
        origin="/events",
        name="Events",
        columns=rrb.TextLogColumns(timeline_columns=["step"], text_log_columns=["body"]),
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


def _reliability() -> rrb.TimeSeriesView:
    name = "Teachers' reliability ± 1 σ, judged by each other"
    return _plot("reliability", name, rrb.Corner2D.RightBottom, (0.0, 1.05))


def _lanes() -> rrb.StateTimelineView:
    shown = rr.TimeRange(
        start=rr.TimeRangeBoundary.cursor_relative(seq=-LANES_SHOWN),
        end=rr.TimeRangeBoundary.cursor_relative(seq=2),
    )
    axis = rrb.archetypes.TimeAxis(link="Independent", view_range=shown)
    name = "Labels · blue ← amber → pink ↑ green ↓"
    return rrb.StateTimelineView(origin="/teachers", name=name, time_view=axis)


def _table() -> rrb.Vertical:
    table = rrb.TextDocumentView(origin=f"/{EPISODES}", name="The latest episodes, newest first")
    return rrb.Vertical(table, name="Episodes")
