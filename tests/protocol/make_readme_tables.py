"""Write the parts of protocol/README.md that follow from the code: field tables and the worked example.

    .venv/bin/python -m tests.protocol.make_readme_tables

test_protocol_readme.py fails where the README says something else than the types.
"""

import json
import re
from collections.abc import Iterator
from hashlib import blake2b
from pathlib import Path

import msgspec
from msgspec import inspect

from protocol import crowd_message, messages, world_messages
from protocol.codec import encode, pack, unpack
from protocol.fields import ACTION_NAME, NAME
from protocol.messages import Acknowledgement, Wire
from tests.protocol.samples import LABEL

README = Path(__file__).parents[2] / "protocol" / "README.md"
PART = re.compile(r"<!-- (?P<name>\w+): generated -->\n.*?<!-- end -->", re.DOTALL)

MEANINGS = {
    "schema": "the version of this contract; write it into every message",
    "session": "name of the session",
    "teacher": "name of the teacher",
    "epoch": "which life of the learner; it grows when a learner takes the session up again",
    "sequence": "running number of the decision's announcements within an epoch",
    "decision": "running number of the decision over the whole session, from 0",
    "Welcome.decision": "the decision as it stands",
    "episode": "number of the episode, from 0",
    "step": "step within the episode, from 0",
    "Begun.step": "how many of the given actions were executed",
    "phase": "where the session is in its round; answer only while `asking`",
    "SessionSummary.phase": "where the session is in its round",
    "paused": "whether the count-down is held",
    "asked": "what teachers are asked for",
    "state": "opaque key of the state; copy it into the answer",
    "Executed.state": "key of the state after the action",
    "view": "the state to show, see *Views*",
    "actions": "names of the actions, by index",
    "Begin.actions": "actions already taken in this episode, executed again",
    "action": "name of an action",
    "Decision.action": "what the agent did or does; null while labels are asked for",
    "Step.action": "what the agent did",
    "SaidBy.action": "the action that was named",
    "Answer.action": "the action you would take (kind `label`), or what should have been done (`mistake`)",
    "remaining_ms": "ms until the window closes, at the sending; null: no deadline or paused",
    "window": "the window for answers",
    "Control.window": "the new window (verb `window`)",
    "teachers": "names of teachers who are present, the first 64 in alphabetical order",
    "teachers_present": "how many teachers are present",
    "method": "name of the learning method",
    "episodes": "how many episodes the session has",
    "Welcome.episodes": "the latest finished episodes, for curves",
    "SessionReport.episodes": "finished episodes from `first_episode` on, at most 100",
    "optimal_steps": "fewest steps from the episode's start; null where no exact solver reaches",
    "at_ns": "when the learner learnt it, ns since 1970",
    "said": "what teachers said, by name",
    "label": "the merged label; null for silence",
    "h": "the teachers' part of the reward; 0 is silence",
    "reward": "the environment's reward",
    "SaidBy.reward": "praise or blame",
    "Answer.reward": "praise or blame (kind `reward`)",
    "td_error": "temporal-difference error without h (paper, Eq. 2)",
    "td_error_shaped": "temporal-difference error with h (Eq. 4)",
    "outcome": "how the episode stands after the step",
    "Episode.outcome": "how the episode ended",
    "next_view": "the state after the action, to show",
    "values": "Q of the state after the update, by action",
    "steps": "steps of the episode",
    "abs_td_error": "mean of |td_error| over the steps",
    "abs_td_error_shaped": "mean of |td_error_shaped| over the steps",
    "discounted_return": "sum of gamma^t (r + h)",
    "discounted_env_return": "sum of gamma^t r",
    "inputs": "answers applied",
    "agreements": "steps with h > 0",
    "kind": "what is said",
    "environment": "its registered id, such as `FrozenLake-v1`",
    "options": "what it is made with, such as `is_slippery`",
    "GymWorld.actions": "names of its actions, by index",
    "GymWorld.level_name": "name of the world, for people",
    "GymWorld.starts": "N: episodes begin from N drawn resets in turn; `all`: each from one of its own",
    "render": "what a view is: see *Views*",
    "reward_scale": "what its rewards are multiplied by",
    "GymWorld.goal_reward": "what ending well pays, scaled, for warnings; null where nobody knows",
    "GymWorld.step_reward": "what a step pays at most, scaled, for warnings",
    "aggregator": "name under which the crowd teaches",
    "Crowd.epoch": "which life of the aggregator",
    "Crowd.at_ns": "when the round closed, ns since 1970 on the aggregator's clock",
    "Crowd.action": "what was handed on; null for an abstention or nothing",
    "Crowd.posterior": "probability by action name; null where no label was given",
    "cause": "why the round closed: its quorum, its deadline, or the learner went on without it",
    "members": "workers who are present",
    "answered": "workers whose answer counted",
    "conclusions": "rounds that the workers' reliability was learnt from",
    "too_late": "conclusions that reached the learner after its window",
    "workers": "who answered last first, at most 256",
    "worker": "pseudonym of the worker",
    "mean": "estimated probability that an answer is right",
    "standard_error": "standard deviation of that estimate",
    "WorkerReliability.labels": "answers that the estimate rests on",
    "standing": "`unknown`, `good`, `spam` or `adversary`",
    "present": "whether the worker is there now",
    "client": "name and version of your program, for logs",
    "token": "identity token, where the deployment hands them out; never journaled",
    "rights": "what you may do",
    "answer_id": "16 random bytes, made and stored before sending; the acknowledgement names it again",
    "guidance": "actions worth considering (kind `guidance`)",
    "mistake": "the steps that went wrong (kind `mistake`)",
    "posterior": "probability by action name, from aggregators",
    "response_ms": "ms from showing the decision to the answer, on your own clock",
    "code": "see *Acknowledgements*",
    "Refusal.code": "see *Refusals*",
    "reason": "one line for people",
    "check": "BLAKE2b with an 8-byte digest over the answer's payload as it was sent, keyed with "
    "the Welcome's `check_key` where it had one",
    "check_key": "key of the checks in your acknowledgements; keep it to yourself",
    "journal_seq": "place of the answer in the learner's journal",
    "verb": "what is to be done",
    "ok": "whether it was done",
    "mode": "`early`: closes at the quorum; `full`: after the span; `until-answered`: at the quorum alone",
    "span_ms": "length of the window in ms",
    "quorum": "answers that close the window; 0: everyone present, and at least one",
    "first_step": "first step of the stretch",
    "last_step": "last step of the stretch",
    "level": "the level in XSB",
    "level_name": "name of the level, for people",
    "starts": "`1`: the level's own; N: that and N-1 drawn ones; `all` solvable ones; `within:K` steps",
    "goal_reward": "added to the step that solves",
    "step_reward": "paid for every step",
    "deadlock_reward": "added to the step that makes the level unsolvable",
    "steps_max": "cap of an episode in steps; a capped episode is cut off, not terminal",
    "world": "the world of the session",
    "may_undo": "whether an answer of the kind `undo` is welcome once the action was seen",
    "parameters": "parameters of the method that differ from its defaults: numbers, or words of a choice",
    "seed": "names every draw of the session",
    "teachers_min": "teachers who must have joined before the first decision",
    "branch": "name of the new session",
    "Branch.episode": "the episode to begin with; those before it are kept",
    "leave_out": "0 for the latest page of a list, then what the `older` of the last one said",
    "first_episode": "number of the first episode to report",
    "RowsQuery.after_seq": "the last row already read; 0 begins at the beginning",
    "JournalRows.after_seq": "the last row that this reply covers: ask from here next",
    "rows": "rows of the journal in order; erased ones are left out",
    "whole": "whether there was nothing after these rows",
    "seq": "number of the row within its journal",
    "JournalRow.kind": "kind of the row, see services/runtime/journal/README.md",
    "JournalRow.at_ns": "time of the row, ns since 1970",
    "body": "the row's body",
    "submitted": "answers that came, abstentions and repeats apart",
    "acknowledged": "of these, kept",
    "applied": "learnt from",
    "superseded": "after the close, or replaced by the same teacher's later answer",
    "late": "after the deadline",
    "rejected": "answered nothing that was asked",
    "pending": "in the open window, or waiting for their step",
    "sessions": "one line each",
    "older": "`leave_out` of the question for the next page; null: no older sessions are left",
    "shards": "of how many shards the deployment's sessions are",
    "told": "numbers of the shards, from 0, whose sessions this list tells of",
    "summary": "one line about the session",
    "config": "what the session was created with",
    "labels": "what became of its answers",
    "teaching_ns": "time from the opening of decisions to their update, summed, in ns",
    "q_sha256": "SHA-256 of the table, hex",
    "malformed": "messages that could not be read, by sender",
    "failure": "why the session was stopped before its end; empty otherwise",
}
"""By field, or by message and field where that message means something of its own."""

_PATTERNS = {NAME: "name", ACTION_NAME: "action"}


def types() -> list[type[msgspec.Struct]]:
    """Every message and every part of one, in the order of their files."""
    return [
        each
        for each in (*vars(messages).values(), *vars(crowd_message).values(), *vars(world_messages).values())
        if isinstance(each, type) and issubclass(each, msgspec.Struct) and each not in (Wire, msgspec.Struct)
    ]


def said(kind: inspect.Type) -> str:  # noqa: C901, PLR0911, PLR0912 - a case a type
    """A type in the words of the README."""
    match kind:
        case inspect.BoolType():
            return "bool"
        case inspect.NoneType():
            return "null"
        case inspect.LiteralType(values):
            return " or ".join(f"`{value}`" for value in values)
        case inspect.IntType(ge=None, le=None):
            return "int"
        case inspect.IntType(ge=low, le=high):
            return f"int {_number(low)} to {_number(high)}"
        case inspect.FloatType(ge=low, le=high):
            return "float, finite" if low == -1.7e308 else f"float {low:g} to {high:g}"
        case inspect.StrType(pattern=pattern) if pattern in _PATTERNS:
            return _PATTERNS[pattern]
        case inspect.Metadata(type=inspect.StrType(), extra={"form": form}):
            return _PATTERNS[form]
        case inspect.StrType(pattern=str(pattern)):
            return f"text of the form `{pattern}`".replace("|", "\\|").replace("\\Z", "$")
        case inspect.StrType(max_length=length):
            return "text" if length is None else f"text, at most {length} characters"
        case inspect.BytesType(min_length=low, max_length=high):
            return f"{high} bytes" if low == high else f"at most {high} bytes"
        case inspect.VarTupleType(item_type=item, max_length=length):
            return f"list of {said(item)}" + ("" if length is None else f", at most {length}")
        case inspect.DictType(key_type=key, value_type=value, max_length=length):
            return f"map of {said(key)} to {said(value)}" + ("" if length is None else f", at most {length}")
        case inspect.StructType(cls=cls):
            return f"[{cls.__name__}](#{_anchor(cls)})"
        case inspect.UnionType(members):
            return " or ".join(said(each) for each in members)
    raise TypeError(kind)


def _number(value: int | None) -> str:
    powers = {2**53 - 1: "2^53 - 1", 2**63 - 1: "2^63 - 1", 2**40: "2^40"}
    return powers.get(value or 0, str(value))


def title(each: type[msgspec.Struct]) -> str:
    tag = each.__struct_config__.tag if each.__struct_config__.tag_field == "type" else None
    return f"{each.__name__}, type `{tag}`" if tag else each.__name__


def _anchor(each: type[msgspec.Struct]) -> str:
    return re.sub(r"[^a-z0-9 -]", "", title(each).lower()).replace(" ", "-")


def table(each: type[msgspec.Struct]) -> Iterator[str]:
    """The section of one message."""
    yield f"### {title(each)}"
    yield ""
    yield str(each.__doc__)
    yield ""
    yield "| field | type | | meaning |"
    yield "|---|---|---|---|"
    info = inspect.type_info(each)
    assert isinstance(info, inspect.StructType)
    if info.tag_field == "kind":
        yield f"| `kind` | `{info.tag}` | always | what world it is |"
    for field in info.fields:
        meaning = MEANINGS.get(f"{each.__name__}.{field.name}") or MEANINGS[field.name]
        need = "always" if field.required or field.name == "schema" else f"else {_default(field)}"
        yield f"| `{field.name}` | {said(field.type)} | {need} | {meaning} |"
    yield ""


def _default(field: inspect.Field) -> str:
    value = field.default if field.default is not msgspec.NODEFAULT else field.default_factory()
    shown = list(value) if isinstance(value, tuple) else value
    return {None: "null", "": "empty", (): "empty"}.get(value, f"`{shown}`") if value != {} else "empty"


def example() -> Iterator[str]:
    """The worked example: an answer byte by byte, its check, its acknowledgement."""
    payload = encode(LABEL)
    value = unpack(payload)
    yield "```"
    yield f"de 00 {len(value):02x}".ljust(56) + f"map of {len(value)} pairs"
    for key, each in value.items():
        pair = pack(key).hex(" ") + "  " + pack(each).hex(" ")
        meaning = f"{key}: {each.hex() if isinstance(each, bytes) else json.dumps(each)}"
        yield f"{pair}".ljust(56) + f"  {meaning}" if len(pair) > 56 else pair.ljust(56) + meaning
    yield "```"
    yield ""
    check = blake2b(payload, digest_size=8).digest()
    reply = Acknowledgement(
        answer_id=LABEL.answer_id, code="accepted", check=check, epoch=LABEL.epoch, journal_seq=77
    )
    yield f"These are {len(payload)} bytes, and their check is `{check.hex()}`. The reply to them:"
    yield ""
    yield "```"
    raw = encode(reply).hex(" ")
    yield from (raw[first : first + 96].strip() for first in range(0, len(raw), 96))
    yield "```"


def parts() -> dict[str, str]:
    """The generated parts by name."""
    lines = [line for each in types() for line in table(each)]
    return {"fields": "\n".join(lines).rstrip(), "example": "\n".join(example())}


def filled(text: str) -> str:
    """The README with its generated parts as they should be."""
    generated = parts()
    return PART.sub(
        lambda found: f"<!-- {found['name']}: generated -->\n{generated[found['name']]}\n<!-- end -->", text
    )


if __name__ == "__main__":
    README.write_text(filled(README.read_text(encoding="utf-8")), encoding="utf-8")
