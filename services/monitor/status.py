"""The sentences of the monitor: how things stand now, and what has happened."""

from collections.abc import Iterable

from protocol.fields import OutcomeName
from protocol.messages import Decision, Episode, SaidBy, SessionReport, Step, WindowSpec
from services.monitor.config import TEACH

PHASES = {
    "gathering": "waiting for teachers",
    "beginning": "beginning an episode",
    "ready": "ready to go on",
    "asking": "asking the teachers",
    "executing": "acting",
    "finished": "finished",
}
WINDOWS = {"early": "closes early", "full": "full span", "until-answered": "until answered"}
SIGNS = {"LEFT": "←", "RIGHT": "→", "UP": "↑", "DOWN": "↓"}
NAMES_SHOWN_MAX = 6
BAR = 10
"""Squares of the count-down."""
NOW = "now"
EPISODES = "episodes"
EPISODES_SHOWN = 24
"""As many as a window shows at once: the newest is the last of them, as in the events."""
OF_TWO = "of two, nothing tells which one errs"
"""One line of a pane that shows five."""
ENDS: dict[OutcomeName, str] = {
    "solved": "solved",
    "deadlock": "ended in a deadlock",
    "failed": "failed",
    "cap": "gave up",
    "running": "stopped",
}


def open_markdown(
    decision: Decision | None,
    report: SessionReport | None,
    left_s: float | None,
    waited_s: float,
    teach: str = TEACH,
    *,
    of_two: bool = False,
) -> str:
    """Return how the session stands at this moment.

    Args: left_s: seconds until the open window closes, None without a deadline; waited_s: seconds since the
    learner last said anything; teach: how a session is taught here, as `MonitorConfig.teach`;
    of_two: the teachers are two, judged by each other.
    """
    if decision is None:
        return "\n\n".join(_standing(report, teach))
    phase = f"**{_phase(decision)}**{_count_down(decision, left_s, waited_s)}"
    lines = [_heading(decision), phase]
    method = f"method **{decision.method}** · window {_window(decision.window)}"
    lines += [_present(decision), *[OF_TWO] * of_two, method]
    lines += _hint(decision.phase, decision.session, teach)
    return "\n\n".join(lines)


def step_markdown(step: Step, decision: Decision | None, *, of_two: bool = False) -> str:
    """Return what a learnt step was: what was said, done and learnt."""
    of = "" if decision is None else f" of {decision.episodes}"
    heading = f"**{step.session}** · episode {step.episode + 1}{of}, step {step.step + 1}"
    lines = [heading, f"agent went **{_sign(step.action)}**"]
    if step.said:
        said = " · ".join(_saying(each) for each in step.said[:NAMES_SHOWN_MAX])
        more = len(step.said) - NAMES_SHOWN_MAX
        lines.append(said + (f" and {more} more" if more > 0 else "") + f" → h {step.h:+.2g}")
    else:
        lines.append("nobody said anything")
    lines.append(f"reward {step.reward:+g} · TD error {step.td_error:+.3f}")
    lines += [OF_TWO] * of_two
    return "\n\n".join(lines)


def event_of_episode(episode: Episode) -> str:
    """Return one line about a finished episode."""
    steps = counted(episode.steps, "step")
    if episode.optimal_steps is not None:
        # Beside an end in a deadlock, fewer steps than "fewest" would read as a mistake.
        steps += (
            f" ({'fewest' if episode.outcome == 'solved' else 'to solve it takes'} {episode.optimal_steps})"
        )
    return (
        f"episode {episode.episode + 1} {ENDS[episode.outcome]}: {steps}, "
        f"return {episode.discounted_return:+.2f}, {counted(episode.inputs, 'input')}"
    )


def heading_of(decision: Decision) -> str:
    """Return what is taught and how, as a heading."""
    return f"### {decision.session} · method {decision.method} · {counted(decision.episodes, 'episode')}"


def episodes_markdown(episodes: Iterable[Episode], heading: str | None = None) -> str:
    """Return finished episodes as a table, below its heading."""
    head = (
        "| episode | steps | fewest to solve | return | mean abs. TD error | teacher inputs | how it ended |"
    )
    rows = [
        f"| {episode.episode + 1} | {episode.steps} | {'' if fewest is None else fewest} "
        f"| {episode.discounted_return:+.2f} | {episode.abs_td_error:.3f} | {episode.inputs} "
        f"| {ENDS[episode.outcome]} |"
        for episode in episodes
        for fewest in (episode.optimal_steps,)
    ]
    above = [] if heading is None else [heading, ""]
    return "\n".join([*above, head, "|--:|--:|--:|--:|--:|--:|:--|", *rows])


def events_between(before: Decision | None, after: Decision) -> list[str]:
    """Return a line for each thing that changed from one decision to a later one."""
    if before is None:
        return [f"watching: {after.method}, {counted(after.episodes, 'episode')}, now {PHASES[after.phase]}"]
    events = []
    if after.paused != before.paused:
        events.append("paused" if after.paused else "resumed")
    if after.phase == "finished" != before.phase:
        events.append("session finished")
    if after.epoch != before.epoch:
        events.append(f"the learner was restarted or replaced (epoch {after.epoch})")
    if after.window != before.window:
        events.append(f"the window for answers is now {_window(after.window)}")
    for verb, names in (
        ("joined", sorted(set(after.teachers) - set(before.teachers))),
        ("left", sorted(set(before.teachers) - set(after.teachers))),
    ):
        if names:
            events.append(f"{_listed(names)} {verb}")
    return events


def _standing(report: SessionReport | None, teach: str) -> list[str]:
    if report is None:
        return ["### Waiting for the session"]
    summary = report.summary
    return [
        f"**{summary.session}** · {summary.episode} of {summary.episodes} episodes",
        f"**{PHASES.get(summary.phase, summary.phase)}** · method **{summary.method}**",
        f"level {summary.level_name} · {counted(report.labels.applied, 'answer')} applied",
        *_hint(summary.phase, summary.session, teach),
    ]


def _hint(phase: str, session: str, teach: str) -> list[str]:
    return [f"teach it: {teach.replace('{session}', session)}"] if phase == "gathering" else []


def _heading(decision: Decision) -> str:
    """Return where the session is; between episodes and after the last, the step is one that has been."""
    if decision.phase == "finished":
        return f"**{decision.session}** · {decision.episode} of {counted(decision.episodes, 'episode')}"
    step = "" if decision.phase == "beginning" else f", step {decision.step + 1}"
    return f"**{decision.session}** · episode {decision.episode + 1} of {decision.episodes}{step}"


def _window(window: WindowSpec) -> str:
    length = "" if window.mode == "until-answered" else f"{window.span_ms / 1000:g} s, "
    return length + WINDOWS[window.mode]


def _phase(decision: Decision) -> str:
    return "paused" if decision.paused else PHASES[decision.phase]


def _count_down(decision: Decision, left_s: float | None, waited_s: float) -> str:
    if decision.phase != "asking" or decision.paused:
        return ""
    if left_s is None:
        return f" · no deadline, open for {waited_s:.0f} s"
    share = left_s / max(left_s, decision.window.span_ms / 1000)
    bar = "■" * round(share * BAR) + "□" * (BAR - round(share * BAR))
    return f" {bar} {left_s:.1f} s left"


def _present(decision: Decision) -> str:
    present = f"teachers: {decision.teachers_present} present"
    return f"{present}, {_listed(decision.teachers)}" if decision.teachers else present


def _sign(action: str) -> str:
    return SIGNS.get(action, action)


def _saying(said: SaidBy) -> str:
    if said.action is not None:
        return f"{said.teacher} said **{_sign(said.action)}**"
    if said.reward is not None:
        return f"{said.teacher} gave **{said.reward:+g}**"
    return f"{said.teacher}: {said.kind}"


def _listed(names: tuple[str, ...] | list[str]) -> str:
    more = len(names) - NAMES_SHOWN_MAX
    return ", ".join(names[:NAMES_SHOWN_MAX]) + (f" and {more} more" if more > 0 else "")


def counted(count: int, thing: str) -> str:
    """Return a number of things in words."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"
