"""RELIABILITY.md is what the generator makes of stored results, and its tests exist."""

import ast

from tests.services.faults.campaigns import FAULTS, TESTS
from tests.services.faults.table import ROOT, TABLE, render, stored


def functions_of(path: str) -> set[str]:
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_the_published_table_is_what_the_stored_results_say() -> None:
    assert TABLE.read_text(encoding="utf-8") == render(stored())


def test_every_fault_has_a_result_in_full_and_every_row_names_a_test_that_exists() -> None:
    results = {result.name: result for result in stored()}
    assert {fault.name for fault in FAULTS} <= set(results)
    assert [fault.name for fault in FAULTS if results[fault.name].count < fault.full] == []
    for result in results.values():
        path, name = result.test.split("::")
        assert name in functions_of(path), result.test


def test_every_test_of_a_fault_is_in_the_table() -> None:
    wanted = {name for name in functions_of(TESTS) if name.startswith("test_")}
    assert wanted == {fault.test for fault in FAULTS}
