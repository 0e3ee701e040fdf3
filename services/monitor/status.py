"""The sentences of the monitor: how things stand now, and what has happened."""

from protocol.messages import Decision, Episode, SessionReport

PHASES = {
    "gathering": "waiting for teachers",
    "beginning": "beginning an episode",
    "ready": "ready to go on",
    "asking": "asking the teachers",
    "executing": "acting",
    "finished": "finished",
}
WINDOWS = {"early": "closes early", "full": "full span", "until-answered": "until answered"}
NAMES_SHOWN_MAX = 6


def status_markdown(decision: Decision | None, report: SessionReport | None, unreadable_views: int) -> str:
    """Return the text of the `Now` pane: what is known, nothing else."""
    lines = _standing(decision, report)
    if unreadable_views:
        lines.append(f"views that could not be drawn: {unreadable_views}")
    return "\n\n".join(lines)


def event_of_episode(episode: Episode) -> str:
    """Return one line about a finished episode."""
    ends = {"solved": "solved", "deadlock": "ended in a deadlock", "cap": "gave up", "running": "stopped"}
    fewest = "" if episode.optimal_steps is None else f" (fewest possible {episode.optimal_steps})"
    return (
        f"episode {episode.episode + 1}: {ends[episode.outcome]} "
        f"after {_counted(episode.steps, 'step')}{fewest}, "
        f"return {episode.discounted_return:+.2f}, {_counted(episode.inputs, 'teacher input')}"
    )


def events_between(before: Decision | None, after: Decision) -> list[str]:
    """Return a line for each thing that changed from one decision to a later one."""
    if before is None:
        return [f"watching: {after.method}, {_counted(after.episodes, 'episode')}, now {PHASES[after.phase]}"]
    events = []
    if after.paused != before.paused:
        events.append("paused" if after.paused else "resumed")
    if after.phase == "finished" != before.phase:
        events.append("session finished")
    if after.epoch != before.epoch:
        events.append(f"the learner was restarted or replaced (epoch {after.epoch})")
    if after.window != before.window:
        events.append(
            f"the window for answers is now {after.window.span_ms} ms, {WINDOWS[after.window.mode]}"
        )
    for verb, names in (
        ("joined", sorted(set(after.teachers) - set(before.teachers))),
        ("left", sorted(set(before.teachers) - set(after.teachers))),
    ):
        if names:
            events.append(f"{_listed(names)} {verb}")
    return events


def _standing(decision: Decision | None, report: SessionReport | None) -> list[str]:
    if decision is not None:
        phase = "paused" if decision.paused else PHASES[decision.phase]
        present = f"{decision.teachers_present} present"
        teachers = f"{present}: {_listed(decision.teachers)}" if decision.teachers else present
        window = f"{decision.window.span_ms / 1000:g} s, {WINDOWS[decision.window.mode]}"
        shown = min(decision.episode + 1, decision.episodes)
        return [
            f"### Episode {shown} of {decision.episodes} · step {decision.step}",
            f"**{phase}** · method **{decision.method}** · window {window}",
            f"teachers {teachers}",
        ]
    if report is not None:
        summary = report.summary
        return [
            f"### {summary.episode} of {summary.episodes} episodes",
            f"**{PHASES.get(summary.phase, summary.phase)}** · method **{summary.method}**",
            f"level {summary.level_name} · {_counted(report.labels.applied, 'answer')} applied",
        ]
    return ["### Waiting for the session"]


def _listed(names: tuple[str, ...] | list[str]) -> str:
    more = len(names) - NAMES_SHOWN_MAX
    return ", ".join(names[:NAMES_SHOWN_MAX]) + (f" and {more} more" if more > 0 else "")


def _counted(count: int, thing: str) -> str:
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"
