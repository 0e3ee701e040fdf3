"""The keys of `sfid up --config`: the page, the printed sample and the code say the same."""

import re
from pathlib import Path

from services.cli.config_keys import key_rows, page
from services.runtime.config import Config, config_keys, read_config
from tests.services.cli.command_line import sfid

ROOT = Path(__file__).parents[3]


def test_the_page_has_every_key_as_the_code_has_it() -> None:
    """Make it again after a change: `python -m services.cli.config_keys > CONFIGURATION.md`."""
    written = (ROOT / "CONFIGURATION.md").read_text(encoding="utf-8")
    assert written == page()
    assert re.findall(r"^\| `([a-z_.]+)` \|", written, re.MULTILINE) == [name for name, _, _ in config_keys()]


def test_every_key_says_what_it_takes_and_means() -> None:
    rows = {row.name: row for row in key_rows()}
    assert [name for name, row in rows.items() if not (row.takes and row.meaning)] == []
    assert rows["learner.shards"].takes == "a whole number, 1 to 64"
    assert rows["aggregator.gold_share"][2:4] == ("a number, 0 to 1", "0.0")
    assert rows["aggregator.quorum"].takes == "a whole number, 0 or more"
    assert rows["gateway.url"][2:4] == ("text", "")


def test_the_printed_file_holds_every_key_at_its_default(tmp_path: Path) -> None:
    done = sfid("up", "--keys")
    assert (done.code, done.stderr) == (0, "")
    file = tmp_path / "sfid.toml"
    file.write_text(done.stdout)
    assert read_config(file) == Config()
    keys = re.findall(r"^(?:# )?([a-z_]+) = ", done.stdout, re.MULTILINE)
    assert keys == [row.key for row in key_rows()]


def test_the_readmes_example_is_of_keys_that_there_are(tmp_path: Path) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    block = readme.partition("`sfid up --config FILE` reads TOML")[2].partition("\n## ")[0]
    file = tmp_path / "sfid.toml"
    file.write_text("\n".join(re.findall(r"^ {4}(.*)$", block, re.MULTILINE)))
    assert read_config(file) == Config()
