"""Write protocol/vectors: the bytes of one full example of every message, and a readable twin of each.

    .venv/bin/python -m tests.protocol.make_vectors

Run it for a new message or a new schema only: bytes that were published once are kept for ever, and
test_vectors.py holds them against the codec.
"""

import json
from pathlib import Path
from typing import Any

from protocol.codec import encode, unpack
from protocol.messages import Wire
from tests.protocol.samples import FULL, OTHER_WORLDS

VECTORS = Path(__file__).parents[2] / "protocol" / "vectors"


def type_name(message: Wire) -> str:
    """The `type` of the message on the wire."""
    return str(type(message).__struct_config__.tag)


NAMED: dict[str, Wire] = {type_name(message): message for message in FULL} | OTHER_WORLDS


def readable(value: Any) -> Any:  # noqa: ANN401 - any msgpack value
    """The value as JSON can hold it: bytes as {"hex": ...}, everything else as it is."""
    if isinstance(value, bytes):
        return {"hex": value.hex()}
    if isinstance(value, dict):
        return {key: readable(each) for key, each in value.items()}
    if isinstance(value, list):
        return [readable(each) for each in value]
    return value


def main() -> None:
    VECTORS.mkdir(exist_ok=True)
    for name, message in NAMED.items():
        payload = encode(message)
        (VECTORS / f"{name}.bin").write_bytes(payload)
        twin = json.dumps(readable(unpack(payload)), indent=2, ensure_ascii=True)
        (VECTORS / f"{name}.json").write_text(twin + "\n", encoding="ascii")


if __name__ == "__main__":
    main()
