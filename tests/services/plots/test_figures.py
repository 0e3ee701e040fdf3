"""Figures show the numbers they are given, in files whose bytes depend on nothing else."""

import os
import struct
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb

from services.plots.curves import draw_curves
from services.plots.dots import draw_dots
from services.plots.figures import (
    curve_lines,
    total_grid,
    write_curves,
    write_dots,
    write_figure2,
    write_heat_table,
)
from services.plots.heat_table import draw_heat_table, short
from services.plots.model import Grid, Line, Panel, PlotError, Width
from services.plots.style import DASHES, HUES
from sfid_core.experiments.intervals import Interval, Resampling
from sfid_core.experiments.summary import FOUNDING_MEASURES, Arm, ArmSummary, Measure, summarise

CONDITIONS = [("sfid", "expert"), ("reward", "expert"), ("sfid", "naive"), ("reward", "naive")]
LABELS = ["SfID, expert", "Reward shaping, expert", "SfID, naive", "Reward shaping, naive"]


@pytest.fixture(scope="module")
def summaries() -> tuple[ArmSummary, ...]:
    rng = np.random.default_rng(1)
    course = 8 + 40 * np.exp(-np.arange(30) / 6)
    arms = [
        Arm(*name, {measure: course + 5 * number + rng.normal(size=(20, 30)) for measure in Measure})
        for number, name in enumerate(CONDITIONS)
    ]
    for arm in arms:
        arm.measures[Measure.SOLVED][:] = 1.0
    return summarise(arms, Resampling(resamples=200))


def grid(title: str = "Success") -> Grid:
    values = np.array([[0.05, 0.999], [0.671, np.nan], [0.5, -1.5]])
    return Grid(
        title, ("ql", "sfid", "coach"), ("perfect", "reward-focused"), values, values - 0.1, values + 0.1
    )


def texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def png_size(path: Path) -> tuple[int, int]:
    content = path.read_bytes()
    assert content[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", content[16:24])
    return int(width), int(height)


def test_figure_2_is_drawn_in_the_papers_arrangement_with_every_mean(
    summaries: tuple[ArmSummary, ...],
) -> None:
    titles = ["(a) |TD error|", "(b) Steps", "(c) Discounted return", "(d) Inputs"]
    panels = [
        Panel(title, curve_lines(summaries, measure), optimum=6.0 if measure is Measure.STEPS else None)
        for title, measure in zip(titles, FOUNDING_MEASURES, strict=True)
    ]
    figure = draw_curves(panels, "20 seeds.", Width.COLUMN)
    assert [axes.get_title(loc="left") for axes in figure.axes] == titles
    assert [axes.get_xlabel() for axes in figure.axes] == ["", "", "Episode", "Episode"]
    for axes, measure in zip(figure.axes, FOUNDING_MEASURES, strict=True):
        lines = axes.get_lines()
        assert len(lines) == (5 if measure is Measure.STEPS else 4)
        for line, summary in zip(lines, summaries, strict=False):
            assert np.asarray(line.get_xdata()).tolist() == list(range(1, 31))
            assert np.asarray(line.get_ydata()).tolist() == summary.means[measure].tolist()
        bands = [collection.get_paths()[0].vertices for collection in axes.collections]
        for band, summary in zip(bands, summaries, strict=True):
            drawn = {round(float(y), 9) for y in np.asarray(band)[:, 1]}
            assert drawn == {round(float(y), 9) for y in summary.intervals[measure].reshape(-1)}
    optimum = figure.axes[1].get_lines()[4]
    assert set(np.asarray(optimum.get_ydata()).tolist()) == {6.0}
    assert [text.get_text() for text in figure.texts] == ["20 seeds. Dotted: the optimum."]
    legend = figure.legends[0]
    assert [text.get_text() for text in legend.get_texts()] == LABELS


def test_a_colour_and_a_marker_tell_the_method_and_a_line_style_the_teacher(
    summaries: tuple[ArmSummary, ...],
) -> None:
    lines = curve_lines(summaries, Measure.STEPS)
    assert [(line.label, line.hue, line.dash) for line in lines] == [
        (LABELS[0], 0, 0),
        (LABELS[1], 1, 0),
        (LABELS[2], 0, 1),
        (LABELS[3], 1, 1),
    ]
    figure = draw_curves([Panel("Steps", lines)], "", Width.COLUMN)
    drawn = figure.axes[0].get_lines()
    assert [to_hex(line.get_color()) for line in drawn] == [HUES[0], HUES[1], HUES[0], HUES[1]]
    assert [line.get_marker() for line in drawn] == ["o", "s", "o", "s"]
    assert [line.get_linestyle() for line in drawn] == ["-", "-", "--", "--"]
    assert drawn[1].get_linewidth() > drawn[0].get_linewidth()
    assert drawn[1].get_zorder() < drawn[0].get_zorder()
    assert len(set(map(str, DASHES))) == len(DASHES)


def test_a_measure_that_an_arm_lacks_leaves_its_line_out(summaries: tuple[ArmSummary, ...]) -> None:
    lacking = ArmSummary("ql", "nobody", 20, {}, {}, {})
    assert [line.label for line in curve_lines([*summaries, lacking], Measure.STEPS)] == LABELS


def test_figure_2_is_written_as_png_at_column_width_and_as_svg(
    tmp_path: Path, summaries: tuple[ArmSummary, ...]
) -> None:
    png, svg = write_figure2(summaries, tmp_path / "new" / "figure2", {Measure.STEPS: np.full(30, 6.0)})
    assert (png.name, svg.name) == ("figure2.png", "figure2.svg")
    assert png_size(png)[0] == 1050
    assert sorted(path.name for path in png.parent.iterdir()) == ["figure2.png", "figure2.svg"]
    root = ET.fromstring(svg.read_text(encoding="utf-8"))  # noqa: S314 - our own file
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert root.attrib["width"] == "252pt"
    assert "Means over 20 seeds; bands: 95% intervals." in svg.read_text(encoding="utf-8")
    assert b"Means over 20 seeds; bands: 95% intervals." in png.read_bytes()
    wide, _ = write_figure2(summaries, tmp_path / "wide", width=Width.PAGE)
    assert png_size(wide)[0] == 2100


SCRIPT = """
import sys
import numpy as np
from pathlib import Path
from services.plots.figures import write_curves, write_dots, write_heat_table
from services.plots.model import Grid, Line, Panel
x = np.arange(1.0, 11)
line = Line("a", x, x ** 2, x ** 2 - 1, x ** 2 + 1)
out = Path(sys.argv[1])
write_curves([Panel("Squares", (line,), optimum=3.0)] * 3, out / "curves", "note")
values = np.array([[0.1, 0.2], [0.3, 0.4]])
grid = Grid("Grid", ("a", "b"), ("c", "d"), values, values - 0.05, values + 0.05)
write_heat_table(grid, out / "heat")
write_dots([grid], out / "dots")
assert "matplotlib.pyplot" not in sys.modules
"""


def test_the_same_figure_gives_the_same_bytes_in_another_process(tmp_path: Path) -> None:
    found = []
    for number in ("1", "2"):
        place = tmp_path / number
        subprocess.run(
            [sys.executable, "-c", SCRIPT, str(place)],
            check=True,
            env=os.environ | {"PYTHONHASHSEED": number},
        )
        found.append({path.name: path.read_bytes() for path in sorted(place.iterdir())})
    assert list(found[0]) == [
        *("curves.png", "curves.svg", "dots.png", "dots.svg", "heat.png", "heat.svg"),
    ]
    assert found[0] == found[1]
    assert not any(b"<dc:date>" in content for content in found[0].values())


def test_drawing_leaves_the_settings_of_matplotlib_alone(tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    write_heat_table(grid(), tmp_path / "heat")
    assert dict(mpl.rcParams) == before


def test_a_heat_table_writes_every_value_with_its_interval() -> None:
    figure = draw_heat_table(grid(), "note", Width.COLUMN)
    cells = texts(figure.axes[0])
    assert cells == [
        *(".05", "\N{MINUS SIGN}0.05–.15", "1.0", ".90–1.1"),
        *(".67", ".57–.77", "–"),
        *(".50", ".40–.60", "\N{MINUS SIGN}1.5", "\N{MINUS SIGN}1.6–\N{MINUS SIGN}1.4"),
        *("ql", "sfid", "coach", "perfect", "reward-focused"),
    ]
    assert [text.get_text() for text in figure.texts] == ["Success", "note"]
    shades = [sum(to_rgb(patch.get_facecolor())) for patch in figure.axes[0].patches]
    assert len(shades) == 5
    assert sorted(shades, reverse=True) == [shades[4], shades[0], shades[3], shades[2], shades[1]]


def test_totals_of_arms_become_a_grid_of_methods_by_teachers() -> None:
    def arm(method: str, teacher: str, mean: float) -> ArmSummary:
        return ArmSummary(method, teacher, 9, {}, {}, {"success": (mean, Interval(mean - 0.1, mean + 0.2))})

    found = total_grid([arm("sfid", "a", 0.5), arm("coach", "b", 0.6), arm("sfid", "b", 0.7)], "success", "t")
    assert (found.title, found.rows, found.columns) == ("t", ("SfID", "coach"), ("a", "b"))
    assert found.values == pytest.approx(np.array([[0.5, 0.7], [np.nan, 0.6]]), nan_ok=True)
    assert found.lo == pytest.approx(np.array([[0.4, 0.6], [np.nan, 0.5]]), nan_ok=True)
    assert found.hi == pytest.approx(np.array([[0.7, 0.9], [np.nan, 0.8]]), nan_ok=True)


def test_column_names_are_broken_where_they_do_not_fit() -> None:
    values = np.full((1, 6), 0.5)
    names = ("perfect", "label error .2", "reward-focused", "25 % of steps", "x", "a-b")
    wide = Grid("t", ("sfid",), names, values, values, values)
    found = texts(draw_heat_table(wide, "", Width.COLUMN).axes[0])[-6:]
    assert found == ["perfect", "label\nerror .2", "reward-\nfocused", "25 % of\nsteps", "x", "a-b"]


@pytest.mark.parametrize(
    "value, written",
    [(0.0, ".00"), (1.0, "1.0"), (0.996, "1.0"), (0.994, ".99"), (0.5, ".50"), (12.3, "12"), (1.04, "1")],
)
def test_numbers_are_short_in_narrow_cells(value: float, written: str) -> None:
    assert short(value) == written


def test_dots_have_a_row_a_group_and_a_colour_a_series() -> None:
    figure = draw_dots([grid("30 episodes"), grid("300 episodes")], "note", Width.PAGE, (0.0, 1.0))
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["30 episodes", "300 episodes"]
    first = figure.axes[0]
    assert [label.get_text() for label in first.get_yticklabels()] == ["ql", "sfid", "coach"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["perfect", "reward-focused"]
    drawn = first.get_lines()
    assert np.asarray(drawn[0].get_xdata()).tolist() == [0.05, 0.671, 0.5]
    assert [to_hex(line.get_color()) for line in drawn] == [HUES[0], HUES[1]]
    spans = [segment[:, 0].tolist() for segment in first.collections[0].get_segments()]  # type: ignore[attr-defined]
    assert spans == [pytest.approx([v - 0.1, v + 0.1]) for v in (0.05, 0.671, 0.5)]
    assert first.get_xlim() == pytest.approx((-0.03, 1.03))


def test_one_series_needs_no_legend_and_no_limits() -> None:
    values = np.array([[3.0], [5.0]])
    alone = Grid("Ratio", ("4x4", "5x5"), ("guidance",), values, values - 1, values + 1)
    figure = draw_dots([alone], "", Width.COLUMN, None)
    assert figure.legends == []
    left, right = figure.axes[0].get_xlim()
    assert left < 2.0
    assert right > 6.0


def test_what_does_not_fit_is_refused_in_one_line(tmp_path: Path) -> None:
    three, two = np.arange(3.0), np.arange(2.0)
    with pytest.raises(PlotError, match=r"line a has parts of lengths \[2, 3\]"):
        Line("a", three, three, two, three)
    with pytest.raises(PlotError, match="grid 't' has cells of shapes"):
        Grid("t", ("a",), ("b", "c"), np.ones((1, 2)), np.ones((1, 2)), np.ones((2, 2)))
    with pytest.raises(PlotError, match="a figure needs at least one panel"):
        write_curves([], tmp_path / "x")
    with pytest.raises(PlotError, match="all with the same rows and columns"):
        write_dots([], tmp_path / "x")
    with pytest.raises(PlotError, match="are not in order"):
        write_heat_table(grid(), tmp_path / "x", limits=(1.0, 0.0))
    (tmp_path / "file").write_text("")
    with pytest.raises(PlotError, match=r"^cannot write .*heat\.png: .*; give a place you may write to$"):
        write_heat_table(grid(), tmp_path / "file" / "heat")


def test_without_matplotlib_one_line_says_what_to_install() -> None:
    script = (
        "import sys\n"
        "sys.modules['matplotlib'] = None\n"
        "from pathlib import Path\n"
        "from services.plots.figures import write_figure2\n"
        "from services.plots.model import PlotError\n"
        "try:\n"
        "    write_figure2([], Path('x'))\n"
        "except PlotError as error:\n"
        "    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == (
        "figures need matplotlib, which is not installed: pip install 'sfid[plots]', or leave them out\n"
    )
