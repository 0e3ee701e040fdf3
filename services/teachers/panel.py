"""What stands beside the grid: lines of text made of a Progress. No terminal here."""

from rich.text import Text

from protocol.fields import OutcomeName
from protocol.messages import Decision, Episode
from services.teachers.progress import Note, Progress

ARROWS = {"LEFT": "←", "RIGHT": "→", "UP": "↑", "DOWN": "↓"}
BAR_CELLS = 24
GOOD, BAD, QUIET, STRONG = "bold #56b4e9", "bold #e69f00", "dim", "bold"
TEACHERS_NAMED = 6
_BARS = "▁▂▃▄▅▆▇█"
_PHASES = {
    "gathering": "waits for teachers",
    "beginning": "the next episode begins",
    "ready": "between two decisions",
    "asking": "",
    "executing": "the agent acts",
    "finished": "the session is finished",
}
OUTCOMES: dict[OutcomeName, str] = {
    "solved": "solved",
    "deadlock": "stuck (deadlock)",
    "failed": "failed",
    "cap": "gave up (step limit)",
    "running": "",
}


def title(progress: Progress, session: str, teacher: str) -> Text:
    """One line: session, teacher, connection."""
    text = Text(no_wrap=True, overflow="ellipsis")
    text.append(" SfID ", "bold reverse")
    text.append(f" session {session}", STRONG)
    text.append(f"  teacher {teacher}  ")
    if progress.connected and progress.welcomed:
        text.append("● connected", GOOD)
    else:
        text.append("○ not connected", BAD)
    return text


def situation(progress: Progress, now_ns: int) -> Text:
    """Return the lines beside the grid."""
    decision = progress.decision
    if decision is None:
        note = progress.note
        return Text(note.text, BAD) if note.bad else Text("waiting for the first decision…", QUIET)
    text = Text()
    text.append(f"Episode {min(decision.episode + 1, decision.episodes)} of {decision.episodes}", STRONG)
    shortest = "" if decision.optimal_steps is None else f" (shortest {decision.optimal_steps})"
    text.append(f"   step {decision.step + 1}{shortest}\n")
    text.append_text(_last_move(progress, decision))
    text.append("\n")
    text.append_text(question(decision))
    text.append("\n")
    text.append_text(window_line(progress, decision, now_ns))
    text.append("\n\n")
    text.append_text(_answer_line(progress, decision))
    text.append("\n\n")
    text.append_text(_measures(progress, decision, now_ns))
    text.append_text(_company(decision))
    return text


def question(decision: Decision) -> Text:
    """What is asked of the teacher now."""
    if decision.paused:
        return Text("paused: z goes on", BAD)
    if decision.phase != "asking":
        return Text(_PHASES[decision.phase], QUIET)
    if decision.asked == "label":
        return Text("Which way would you go?" if is_ways(decision) else "What would you do?", STRONG)
    if decision.asked == "reward":
        move = f"{ARROWS.get(decision.action or '', '')} {decision.action}"
        return Text.assemble("The agent went ", (move, STRONG), ": + or - ?")
    if decision.asked == "guidance":
        return Text("Which way is worth trying?" if is_ways(decision) else "What is worth trying?", STRONG)
    if decision.asked == "mistake":
        move = f"{ARROWS.get(decision.action or '', '')} {decision.action}"
        return Text.assemble("It went ", (move, STRONG), ". A mistake? Which way instead?")
    return Text(f"asks for {decision.asked}: watch, or abstain", QUIET)


def _last_move(progress: Progress, decision: Decision) -> Text:
    """What the agent did at the step before, where that is not what is asked about."""
    step = progress.step
    if step is None or decision.asked != "label":
        return Text()
    if (step.episode, step.decision + 1) != (decision.episode, decision.decision):
        return Text()
    move = f"{ARROWS.get(step.action, '')} {step.action}".strip()
    stood = ", and nothing moved" if step.view == step.next_view else ""
    labels = {said.action for said in step.said if said.kind == "label"}
    tied = "; the labels were tied" if len(labels) > 1 and step.label is None else ""
    return Text(f"it went {move}{stood}{tied}", QUIET)


def window_line(progress: Progress, decision: Decision, now_ns: int) -> Text:
    """The window: what is left of it as a bar, its mode and span."""
    window = decision.window
    left_ms = progress.remaining_ms(now_ns)
    text = Text(no_wrap=True)
    if decision.phase != "asking" or decision.paused:
        text.append("·" * BAR_CELLS, QUIET)
    elif left_ms is None:
        text.append("━" * BAR_CELLS, QUIET)
    else:
        cells = round(BAR_CELLS * min(1.0, left_ms / window.span_ms))
        text.append("━" * cells, GOOD if cells > BAR_CELLS // 4 else BAD)
        text.append("·" * (BAR_CELLS - cells), QUIET)
        text.append(f" {left_ms / 1000:.1f} s")
    span = "" if window.mode == "until-answered" else f", {window.span_ms / 1000:g} s"
    quorum = f", {window.quorum} answers" if window.quorum else ""
    text.append(f"\nwindow: {window.mode}{span}{quorum}", QUIET)
    return text


def _answer_line(progress: Progress, decision: Decision) -> Text:
    waits = decision.phase == "asking" and not decision.paused
    text = Text.assemble(("you: …" if waits else "you: -", QUIET))
    if progress.answer_text and not progress.answer_before:
        text = Text("you: ")
    elif progress.answer_text:
        text.append("   before: ", QUIET)
    text.append(progress.answer_text, STRONG)
    text.append(f" {progress.answer_fate}", BAD if progress.answer_bad else GOOD)
    return text


def _measures(progress: Progress, decision: Decision, now_ns: int) -> Text:
    text = Text()
    if progress.episodes:
        text.append(f"steps {sparkline([episode.steps for episode in progress.episodes])}\n")
        text.append(f"last episode: {_result(progress.episodes[-1])}\n")
    agreement = progress.agreement
    share = "" if agreement is None else f", {agreement:.0%} {'praised' if progress.by_rewards else 'agreed'}"
    whose = " of all" if decision.teachers_present > 1 else ""
    text.append(f"answers{whose} {progress.inputs}{share}\n")
    minutes, seconds = divmod(int(progress.teaching_s(now_ns)), 60)
    text.append(f"teaching time {minutes}:{seconds:02d}, {progress.answers_saved} of yours saved\n")
    return text


def _result(episode: Episode) -> str:
    shortest = "" if episode.optimal_steps is None else f" (shortest {episode.optimal_steps})"
    return f"{OUTCOMES[episode.outcome]} in {episode.steps}{shortest}"


def _company(decision: Decision) -> Text:
    if not decision.teachers_present:
        return Text()
    named = decision.teachers[:TEACHERS_NAMED]
    if not named:  # nobody is named to each other: in a crowd, or where there are too many
        return Text(f"teachers: {decision.teachers_present}", QUIET)
    more = decision.teachers_present - len(named)
    return Text(f"teachers: {', '.join(named)}" + (f" and {more} more" if more > 0 else ""), QUIET)


def sparkline(numbers: list[int], cells: int = BAR_CELLS) -> str:
    """Return the latest numbers as bars, the greatest of them the full height."""
    latest = numbers[-cells:]
    top = max([*latest, 1])
    return "".join(_BARS[min(len(_BARS) - 1, number * len(_BARS) // (top + 1))] for number in latest)


def is_ways(decision: Decision) -> bool:
    """Tell whether the actions are the four ways and nothing else."""
    return set(decision.actions) == set(ARROWS)


def key_line(decision: Decision | None) -> str:
    """The keys that do something now."""
    if decision is not None and decision.asked == "reward":
        says = "+ = p  praise     - b  blame"
        if decision.may_undo:
            says += "     u  take it back"
    elif decision is not None and decision.asked == "mistake":
        says = "arrows, hjkl or wasd  the way it should have gone"
    elif decision is not None and not is_ways(decision):
        says = "   ".join(f"{number} {name}" for number, name in enumerate(decision.actions[:9], start=1))
    else:
        says = "arrows, hjkl or wasd  the way you would go"
    return f"{says}     space  nothing to say\nm , .  window     z  pause     ?  help     q  leave"


def note_line(note: Note) -> Text:
    """What the teacher is told; a line, where it is wide enough."""
    return Text(note.text, BAD if note.bad else "")
