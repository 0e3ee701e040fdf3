"""SECURITY.md: every threat names its tests, and they are there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (T\d+) \|(.*)\|$", PAGE, re.MULTILINE)


def known_tests() -> set[str]:
    texts = (path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    return {
        name for text in texts for name in re.findall(r"^ *(?:async )?def (test_\w+)\(", text, re.MULTILINE)
    }


def test_threats_are_numbered_one_after_another() -> None:
    assert [number for number, _ in ROWS] == [f"T{number}" for number in range(1, len(ROWS) + 1)]
    assert len(ROWS) >= 22


@pytest.mark.parametrize("number,row", ROWS)
def test_every_threat_names_what_stops_it_and_tests_that_exist(number: str, row: str) -> None:
    cells = [cell.strip() for cell in row.split(" | ")]
    named = re.findall(r"`(test_\w+)`", cells[-1])
    assert (number, len(cells), bool(cells[2]), bool(named)) == (number, 4, True, True)
    assert set(named) - known_tests() == set()


def test_every_other_test_that_the_page_names_exists() -> None:
    assert set(re.findall(r"`(test_\w+)`", PAGE)) - known_tests() == set()


def test_the_commands_that_make_certificates_are_those_that_the_tests_use() -> None:
    used = (ROOT / "tests/services/security/certificates.py").read_text(encoding="utf-8")
    flags = set(
        re.findall(r"(?<=\s)-[a-zA-Z0-9]+", PAGE.partition("## Certificates")[2].partition("## Threats")[0])
    )
    assert {f'"{flag}"' for flag in flags if f'"{flag}"' not in used} == set()
