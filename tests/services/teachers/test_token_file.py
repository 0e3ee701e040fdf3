"""Where a teacher at a terminal keeps their token."""

from pathlib import Path

import pytest

from services.client import TeachingError
from services.teachers.token_file import read_check_key, read_token

SIGNED = "Zm9v.YmFy"


@pytest.mark.parametrize(
    "text",
    [
        SIGNED,
        f"{SIGNED}\n",
        f"{SIGNED}\nacknowledgements {'0a' * 32}\n",
        f"\u2588\u2580\nhttp://127.0.0.1:7480/#t={SIGNED}\nfor ann alone, to teach s1; id 00\n",
    ],
)
def test_a_token_is_read_from_a_file_of_its_own_or_from_a_printed_invitation(
    tmp_path: Path, text: str
) -> None:
    path = tmp_path / "token"
    path.write_text(text)
    assert read_token(path) == SIGNED
    assert read_check_key(path) == (b"\n" * 32 if "acknowledgements" in text else None)


@pytest.mark.parametrize("text", ["", "two.words here.too", "nodot", f"{'x' * 600}.y", "\u00fc.\u00fc"])
def test_a_file_without_a_token_is_refused_with_the_mend_and_without_its_content(
    tmp_path: Path, text: str
) -> None:
    path = tmp_path / "token"
    path.write_text(text)
    with pytest.raises(TeachingError) as caught:
        read_token(path)
    assert str(caught.value) == f"{path}: no token in it: write there what `sfid invite --name NAME` prints"


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(TeachingError, match="No such file or directory: name a readable --token-file"):
        read_token(tmp_path / "none")
