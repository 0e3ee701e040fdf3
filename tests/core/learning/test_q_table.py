"""The table: rows that exist once something was learnt, and a digest of that alone."""

import struct
from hashlib import sha256

from sfid_core.learning.q_table import QTable


def test_looking_at_a_state_leaves_no_row() -> None:
    table = QTable(4)
    assert list(table.values(b"s")) == [0.0] * 4
    assert len(table) == 0
    assert table.sha256() == sha256().hexdigest()


def test_a_row_for_writing_exists_and_keeps_its_values() -> None:
    table = QTable(2)
    table.row(b"s")[1] = 3.0
    table.row(b"t")
    assert dict(table.items()) == {b"s": [0.0, 3.0], b"t": [0.0, 0.0]}
    assert list(table.values(b"s")) == [0.0, 3.0]


def test_the_digest_is_over_keys_and_little_endian_float64_by_ascending_key() -> None:
    table = QTable(2)
    table.row(b"bb")[:] = [1.5, -2.0]
    table.row(b"aa")[:] = [0.0, 1e-300]
    expected = sha256(b"aa" + struct.pack("<2d", 0.0, 1e-300) + b"bb" + struct.pack("<2d", 1.5, -2.0))
    assert table.sha256() == expected.hexdigest()


def test_the_digest_does_not_depend_on_the_order_of_learning_and_notices_the_last_bit() -> None:
    one, other = QTable(1), QTable(1)
    for state in (b"a", b"b"):
        one.row(state)[0] = 1.0
    for state in (b"b", b"a"):
        other.row(state)[0] = 1.0
    assert one.sha256() == other.sha256()
    other.row(b"a")[0] = 1.0 + 2.0**-52
    assert one.sha256() != other.sha256()
