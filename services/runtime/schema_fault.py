"""What a schema found wrong with a file or a flag, in words: where, what is there, what belongs there."""

import re

_AT = re.compile(r"(?P<what>.*?)(?: - at `\$\.?(?P<where>.*)`)?", re.DOTALL)
_FIELD = re.compile(r"Object (?P<fault>missing required|contains unknown) field `(?P<name>.*)`", re.DOTALL)
_TYPE = re.compile(r"Expected `(?P<type>[^`]*)`(?:, got `(?P<got>[^`]*)`)?(?P<bound>.*)", re.DOTALL)
_ENTRY = re.compile(r"\[(\d+)\]")
_WORDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "text in quotes",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
    "null": "nothing",
}


def in_words(fault: str) -> str:
    """Return a fault as msgspec words it as "WHERE: what is wrong: the mend", as it is where it is not known.

    An entry of a list is told by its number from 1: `conditions[1].name` is "conditions 2, name".
    """
    parts = _AT.fullmatch(fault)
    where = _told(parts["where"] or "") if parts else ""
    what = parts["what"] if parts else fault
    field, kind = _FIELD.fullmatch(what), _TYPE.fullmatch(what)
    if field:
        there = f"{where}: " if where else ""
        if field["fault"] == "missing required":
            return f"{there}the key {field['name']} is missing: add it"
        return f"{there}unknown key {field['name']}: correct its name, or take it out"
    if kind:
        return f"{where or 'the file'}: {_misfit(kind['type'], kind['got'], kind['bound'])}"
    return f"{where}: {what}" if where else what


def _misfit(wanted: str, got: str | None, bound: str) -> str:
    belongs = " or ".join(_WORDS.get(one, one) for one in wanted.split(" | ") if one != "null")
    if got is not None:
        return f"{_WORDS.get(got, got)} where {belongs} belongs: change it"
    bound = bound.replace(" matching regex ", " like ")
    return f"give {belongs}{bound}"


def _told(path: str) -> str:
    named = path.replace("[...]", "")
    numbered = _ENTRY.sub(lambda entry: f" {int(entry[1]) + 1}", named)
    return numbered.replace(".", ", ")
