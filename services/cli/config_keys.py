"""The keys of the file that `sfid up --config` reads, as `sfid up --keys` and CONFIGURATION.md tell them.

python -m services.cli.config_keys > CONFIGURATION.md
"""

import json
import sys
import textwrap
from collections.abc import Iterator
from itertools import groupby
from typing import NamedTuple

import msgspec
import typer
from msgspec.inspect import BoolType, FloatType, IntType, NoneType, StrType, Type, UnionType

from services.cli.catalogue import meanings
from services.runtime.config import config_keys

_HEAD = """\
# The configuration of `sfid up`

`sfid up --config FILE` reads TOML. Every key may be left out; a relative path is seen from where the command
is run. `sfid up --keys > FILE` writes a file of all keys at their defaults, with what is said here. Flags
override it: `--data`, `--listen` and `--require-tokens` the keys of their names, `--viewer` `monitor.viewer`,
`--gateway` `gateway.enabled` and `--crowd` `aggregator.enabled`. `section.key` is `key` below `[section]`.

| key | takes | default | meaning |
|---|---|---|---|
"""
_WIDTH = 100


class KeyRow(NamedTuple):
    """One key for people."""

    section: str
    """Empty for keys above all sections."""
    key: str
    takes: str
    default: str
    """As it is written in the file; empty where nothing is said."""
    meaning: str

    @property
    def name(self) -> str:
        """The key with its section."""
        return f"{self.section}.{self.key}".removeprefix(".")


def key_rows() -> Iterator[KeyRow]:
    """Yield every key with what it takes, its default and its meaning."""
    for name, kind, field in config_keys():
        section, _, key = name.rpartition(".")
        default = "" if field.default is None else json.dumps(field.default)
        takes = _takes(msgspec.inspect.type_info(field.type))
        yield KeyRow(section, key, takes, default, meanings(kind)[field.name])


def page() -> str:
    """Return CONFIGURATION.md."""
    lines = []
    for row in key_rows():
        default = f"`{row.default}`" if row.default else "not said"
        lines.append(f"| `{row.name}` | {row.takes} | {default} | {row.meaning} |\n")
    return _HEAD + "".join(lines)


def sample() -> str:
    """Return a file that says every default, with the meanings as comments."""
    lines: list[str] = []
    for section, rows in groupby(key_rows(), lambda row: row.section):
        lines += [f"[{section}]"] if section else []
        for row in rows:
            comment = f"{row.meaning} Takes {row.takes}."
            lines += textwrap.wrap(comment, _WIDTH, initial_indent="# ", subsequent_indent="# ")
            lines += [f"{row.key} = {row.default}" if row.default else f"# {row.key} = ", ""]
    return "\n".join(lines)


def show_keys(asked: bool) -> None:
    """Print the sample and leave, where that is asked for."""
    if asked:
        print(sample(), end="")
        raise typer.Exit


def _takes(kind: Type) -> str:
    match kind:
        case UnionType(types=types):
            return " or ".join(_takes(one) for one in types if not isinstance(one, NoneType))
        case BoolType():
            return "true or false"
        case IntType(ge=low, le=high) | FloatType(ge=low, le=high):
            what = "a whole number" if isinstance(kind, IntType) else "a number"
            return f"{what}, {low or 0:,} " + ("or more" if high is None else f"to {high:,.0f}")
        case StrType(pattern=str()):
            return "a name of a-z, 0-9, - and _"
        case StrType():
            return "text"
    raise TypeError(f"no words for {kind}: give it some in services/cli/config_keys.py")


if __name__ == "__main__":
    sys.stdout.write(page())
