"""The report of a study as one page of HTML: no scripts, nothing from elsewhere, figures inside."""

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path

from services.study.tally import Tally
from sfid_core.study.claims import PEOPLE_MIN, PeopleClaim
from sfid_core.study.definition import Design
from sfid_core.study.effort import SCALES
from sfid_core.study.findings import EffortSummary, Findings

STYLE = """
body { margin: 0; background: #f4f6fa; color: #182033; font: 15px/1.5 system-ui, sans-serif; }
main { max-width: 60rem; margin: 0 auto; padding: 28px 32px; background: #fff; min-height: 100vh; }
h1 { font-size: 1.6rem; margin: 0 0 4px; } h2 { font-size: 1.1rem; margin: 26px 0 8px; }
.soft { color: #56607a; } figure { margin: 0; } figure img { width: 100%; }
.two { display: grid; grid-template-columns: 1fr 1fr; gap: 24px; align-items: start; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 5px 10px 5px 0; border-bottom: 1px solid #dde3ee; }
td.n, th.n { text-align: right; white-space: nowrap; }
.verdict { white-space: nowrap; border-radius: 6px; padding: 1px 8px; background: #e7ebf3; }
.verdict.shown { background: #cfeee2; color: #00583d; }
.warn { border-left: 4px solid #b36b00; padding: 6px 14px; background: #fdf4e3; }
"""


def report_html(found: Findings, counts: Tally, figures: Sequence[tuple[str, Path]]) -> str:
    """Return the report.

    Args: figures: caption and PNG file of each, which are put into the page.
    """
    study = found.study
    design = "each person one condition" if study.design is Design.BETWEEN else "each person all conditions"
    total = (
        f"{counts.opened} opened the page, {len(found.participants)} agreed and are counted here; {design}."
    )
    parts = [
        f"<h1>{escape(study.title)}</h1><p class='soft'>Study {escape(study.name)}. {escape(total)}</p>",
        _warning(found),
        "<h2>People</h2>" + _people(found, counts),
        "<h2>What differs</h2>" + _claims(found.claims),
        *(_figure(caption, path) for caption, path in figures),
        "<h2>Effort in numbers</h2>" + _effort(found.effort) if study.effort else "",
        "<h2>How to read this</h2>" + _notes(found),
    ]
    return (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(study.title)}: report</title><style>{STYLE}</style></head><body><main>"
        + "\n".join(part for part in parts if part)
        + "</main></body></html>\n"
    )


def _warning(found: Findings) -> str:
    few = [name for name, people in found.people.items() if people < PEOPLE_MIN]
    if not few:
        return ""
    listed = ", ".join(f"{name} ({found.people[name]})" for name in few)
    return (
        f"<p class='warn'>Too few people for claims in {escape(listed)}: below {PEOPLE_MIN} a condition this "
        "report shows what was measured and claims nothing.</p>"
    )


def _people(found: Findings, counts: Tally) -> str:
    rows = []
    for name, where in counts.rows.items():
        told = ", ".join(f"{count} {escape(place)}" for place, count in where.items())
        rows.append(f"<tr><td>{escape(name)}</td><td>{told or 'nobody'}</td></tr>")
    whole = ", ".join(f"{people} in {escape(name)}" for name, people in found.people.items())
    head = "<tr><th>condition</th><th>where people are</th></tr>"
    return f"<table>{head}{''.join(rows)}</table><p class='soft'>Whole lessons taught: {whole}.</p>"


def _claims(claims: Sequence[PeopleClaim]) -> str:
    if not claims:
        return "<p>There is one condition: nothing to compare.</p>"
    rows = [
        f"<tr><td>{escape(one.sentence)}</td>"
        f"<td class='n'>{_number(None if one.means is None else one.means[0])}</td>"
        f"<td class='n'>{_number(None if one.means is None else one.means[1])}</td>"
        f"<td class='n'>{_number(one.difference, sign=True)}</td><td class='n'>{_interval(one)}</td>"
        f"<td><span class='verdict {'shown' if one.holds else ''}'>{one.verdict}</span></td></tr>"
        for one in claims
    ]
    level = claims[0].level
    others = {one.other for one in claims}
    named = (claims[0].first, others.pop() if len(others) == 1 else "other")
    columns = "".join(f"<th class='n'>{escape(name)}</th>" for name in (*named, "difference"))
    head = f"<tr><th>claim</th>{columns}<th class='n'>{level:.1%} interval</th><th></th></tr>"
    return f"<table>{head}{''.join(rows)}</table>"


def _effort(effort: Sequence[EffortSummary]) -> str:
    head = "".join(f"<th class='n'>{escape(one.condition)} ({one.people})</th>" for one in effort)
    rows = []
    for place, name in enumerate([*(scale.dimension for scale in SCALES), "Raw score"]):
        cells = "".join(f"<td class='n'>{_rated(one, place)}</td>" for one in effort)
        rows.append(f"<tr><td>{escape(name)}</td>{cells}</tr>")
    return f"<table><tr><th>scale, 0 to 100</th>{head}</tr>{''.join(rows)}</table>"


def _rated(one: EffortSummary, place: int) -> str:
    if not one.people:
        return "-"
    lo, hi = one.intervals[place]
    interval = "" if lo != lo else f" [{lo:.0f}, {hi:.0f}]"  # noqa: PLR0124 - not-a-number differs from itself
    return f"{one.means[place]:.0f}{interval}"


def _figure(caption: str, path: Path) -> str:
    content = base64.b64encode(path.read_bytes()).decode()
    image = f"<img alt='{escape(caption)}' src='data:image/png;base64,{content}'>"
    return f"<h2>{escape(caption)}</h2><figure>{image}</figure>"


def _notes(found: Findings) -> str:
    paired = found.study.design is Design.WITHIN
    who = (
        "Each person is compared with themselves" if paired else "Each group of people is resampled by itself"
    )
    return (
        f"<p class='soft'>Intervals are bootstrap intervals over people, widened for few of them. {who}. The "
        "intervals under &ldquo;What differs&rdquo; hold all at once, at 95 %; those in figures and of the "
        f"effort each for itself. Nothing is claimed below {PEOPLE_MIN} people a condition. Only whole "
        "lessons count; those who had their answers deleted are nowhere in here. Effort is the raw score of "
        "six scales after the NASA Task Load Index (Hart &amp; Staveland 1988).</p>"
    )


def _number(value: float | None, *, sign: bool = False) -> str:
    if value is None:
        return "-"
    return f"{value:+.3g}" if sign else f"{value:.3g}"


def _interval(claim: PeopleClaim) -> str:
    return "-" if claim.ci is None else f"[{claim.ci.lo:+.3g}, {claim.ci.hi:+.3g}]"
