"""What single fields of messages may hold, and a memory of the names that were met.

Three names come with every answer. msgspec matches a pattern anew each time, at 0.3 us a name, which was half
of what an answer's decoding cost; whether a name that was met before has its form is looked up in 0.06 us.
"""

import re
from functools import lru_cache
from typing import Annotated, Literal

from msgspec import Meta

# \Z and not $: a dollar also matches before a line feed at the end, and "ann\n" would be a name.
NAME = r"^[a-z0-9][a-z0-9_-]{0,47}\Z"
ACTION_NAME = r"^[A-Z][A-Z0-9_]{0,31}\Z"

Name = Annotated[str, Meta(pattern=NAME)]
ActionName = Annotated[str, Meta(pattern=ACTION_NAME)]
MetName = Annotated[str, Meta(max_length=48, extra={"form": NAME})]
"""A name that its message holds to the form with `is_name`."""
MetActionName = Annotated[str, Meta(max_length=32, extra={"form": ACTION_NAME})]
"""An action's name that its message holds to the form with `is_action_name`."""
Id = Annotated[bytes, Meta(min_length=16, max_length=16)]
Check = Annotated[bytes, Meta(min_length=8, max_length=8)]
CheckKey = Annotated[bytes, Meta(min_length=32, max_length=32)]
ParameterName = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]{0,31}\Z")]
ParameterWord = Annotated[str, Meta(max_length=32)]
StateKey = Annotated[bytes, Meta(max_length=32)]
Count = Annotated[int, Meta(ge=0, le=2**53 - 1)]
Nanoseconds = Annotated[int, Meta(ge=0, le=2**63 - 1)]
Milliseconds = Annotated[int, Meta(ge=0, le=2**40)]
Finite = Annotated[float, Meta(ge=-1.7e308, le=1.7e308)]
"""Any float64 but NaN and the infinities."""
Reward = Annotated[float, Meta(ge=-1.0, le=1.0)]
Probability = Annotated[float, Meta(ge=0.0, le=1.0)]
Shard = Annotated[int, Meta(ge=0, le=1_023)]
Shards = Annotated[int, Meta(ge=1, le=1_024)]
Text = Annotated[str, Meta(max_length=512)]
View = Annotated[str, Meta(max_length=32_768)]
Token = Annotated[str, Meta(max_length=1024)]
ActionNames = Annotated[tuple[ActionName, ...], Meta(min_length=1, max_length=64)]
Asked = Literal["label", "reward", "guidance", "undo", "mistake", "nothing"]
OutcomeName = Literal["running", "solved", "deadlock", "cap", "failed"]

MET_MAX = 4096
"""Names that are remembered; the one met longest ago is looked at again."""


@lru_cache(MET_MAX)
def is_name(text: str) -> bool:
    """Tell whether the text has the form of a name."""
    return re.match(NAME, text) is not None


@lru_cache(MET_MAX)
def is_action_name(text: str) -> bool:
    """Tell whether the text has the form of an action's name."""
    return re.match(ACTION_NAME, text) is not None
