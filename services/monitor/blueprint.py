"""How the panes are laid out; sent once, because every blueprint that is sent is kept for ever."""

import rerun as rr
import rerun.blueprint as rrb

from services.monitor import curves, doubt_pictures, overview, policy, scene
from services.monitor.status import EPISODES, NOW

BACKGROUND = (11, 13, 18)
LANES_SHOWN, LANES_SHOWN_NARROW = 30, 15
"""Steps that the lanes of labels show: few enough for each to have its sign."""


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
    agreement = f"Share of the last {curves.AGREEMENT_LABELS} labels that the agent agreed with"
    plots = rrb.Grid(
        *_measures(), _plot(curves.AGREEMENT, agreement, span=(0.0, 1.05)), _reliability(), grid_columns=2
    )
    texts = rrb.Horizontal(
        rrb.TextDocumentView(origin=f"/{NOW}", name="Now"),
        _events(),
        _lanes(LANES_SHOWN),
        column_shares=[3, 5, 6],
    )
    return rrb.Vertical(
        rrb.Horizontal(pictures, plots, column_shares=[5, 8]), texts, row_shares=[4.6, 1.4], name="Live"
    )


def _teachers() -> rrb.Horizontal:
    left = rrb.Vertical(
        _picture(doubt_pictures.CONFLICTS, "Where teachers disagree · dark: never · bright: most often"),
        _reliability_named(),
    )
    right = rrb.Vertical(
        _picture(
            doubt_pictures.STATES,
            "Doubtful states: not all said here can be right · below: how often which move was named",
        ),
        rrb.Horizontal(
            rrb.TextDocumentView(origin=f"/{doubt_pictures.LIST}", name="Why to look at these states again"),
            _lanes(LANES_SHOWN_NARROW),
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
    # The column of steps would be too narrow for them; without a column named the viewer shows every one.
    steps = rrb.encodings.TimelineColumn("step", visible=False)
    columns = rrb.TextLogColumns(timeline_columns=[steps], text_log_columns=["body"])
    return rrb.TextLogView(origin="/events", name="Events, newest last", columns=columns)


def _picture(entity: str, name: str) -> rrb.Spatial2DView:
    return rrb.Spatial2DView(origin=f"/{entity}", name=name, background=BACKGROUND)


def _measures() -> list[rrb.TimeSeriesView]:
    """The founding paper's four measures of each episode."""
    return [
        _plot(
            curves.STEPS, f"Steps of each episode · bright: mean of {curves.STEPS_AVERAGED} · grey: fewest"
        ),
        _plot(curves.RETURN, "Return · green: with teachers' part · grey: without"),
        _plot(curves.TD_ERROR, "Mean |TD error| · pale: with teachers' part (Eq. 4)"),
        _plot(curves.INPUTS, "Teacher inputs of each episode"),
    ]


def _plot(
    entity: str, name: str, *, span: tuple[float, float] | None = None, legend: bool = False
) -> rrb.TimeSeriesView:
    """Return a plot; its name says what its curves are, because a legend covers some stretch of them."""
    axis = None if span is None else rrb.ScalarAxis(range=span)
    shown = rrb.PlotLegend(corner=rrb.Corner2D.RightBottom, visible=legend)
    always = rr.TimeRangeBoundary.infinite()
    # Said in full, because a late viewer otherwise keeps the stretch it saw first.
    whole = rrb.archetypes.TimeAxis(link="Independent", view_range=rr.TimeRange(start=always, end=always))
    return rrb.TimeSeriesView(origin=f"/{entity}", name=name, axis_x=whole, axis_y=axis, plot_legend=shown)


def _reliability() -> rrb.TimeSeriesView:
    name = "Reliability ± 1 σ, judged by each other · colours as in World"
    return _plot("reliability", name, span=(0.0, 1.05))


def _reliability_named() -> rrb.TimeSeriesView:
    """With the names below the curves: no reliability is less than nothing."""
    name = "Teachers' reliability ± 1 σ, judged by each other (two or more)"
    return _plot("reliability", name, span=(-0.4, 1.05), legend=True)


def _lanes(steps: int) -> rrb.StateTimelineView:
    shown = rr.TimeRange(
        start=rr.TimeRangeBoundary.cursor_relative(seq=-steps),
        end=rr.TimeRangeBoundary.cursor_relative(seq=2),
    )
    axis = rrb.archetypes.TimeAxis(link="Independent", view_range=shown)
    name = "What teachers said · bright: the agent agreed"
    return rrb.StateTimelineView(origin="/teachers", name=name, time_view=axis)


def _table() -> rrb.Horizontal:
    table = rrb.TextDocumentView(origin=f"/{EPISODES}", name="The latest episodes, newest last")
    plots = rrb.Grid(*_measures(), grid_columns=2)
    return rrb.Horizontal(table, plots, column_shares=[5, 8], name="Episodes")
