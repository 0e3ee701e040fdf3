"""Bad input: exit code 2 and exactly one line that says what is wrong, where, and the mend."""

from pathlib import Path

import pytest

from services.router import free_endpoint
from services.runtime.journal import Shard
from services.runtime.process import DRAIN_MAX_S
from tests.services.cli.command_line import running, sfid, wait_for

pytestmark = pytest.mark.real
WALLED = "######\n{}\n######\n"
LEVELS = {
    "no player": (WALLED.format("# $. #"), "no player"),
    "two players": (WALLED.format("#@$.@#"), "two players"),
    "unequal": (WALLED.format("#@$$.#"), "two boxes and one goal"),
    "open": ("#####\n @$.#\n#####\n", "not enclosed"),
    "empty": ("", "no level found"),
    "binary": ("\x00\x01\x02\x7fELF", "binary, not text"),
    "large": ("#" * 2**20, "too big"),
}


def refused(*arguments: str) -> str:
    """Return the one line with which a command is refused."""
    done = sfid(*arguments)
    lines = done.stderr.splitlines()
    assert (done.code, done.stdout, len(lines)) == (2, "", 1), done
    assert lines[0].startswith("sfid: ")
    assert "Traceback" not in lines[0]
    return lines[0]


@pytest.mark.parametrize("fault", LEVELS)
def test_a_level_that_cannot_be_played_is_refused_by_its_fault(tmp_path: Path, fault: str) -> None:
    text, named = LEVELS[fault]
    path = tmp_path / "bad.xsb"
    path.write_text(text)
    line = refused("levels", "show", str(path))
    assert named in line
    assert str(path) in line


@pytest.mark.parametrize(
    "arguments, named",
    [
        (("--level", "nowhere.xsb"), "no level 'nowhere.xsb'"),
        (("--level", "room:99"), "room:0"),
        (("--method", "sorcery"), "choose one of"),
        (("--teacher", "sage"), "choose from oracle, expert"),
        (("--starts", "0"), "starts '0' is unknown"),
        (("--seed", "-1"), "seed -1 is outside"),
        (("--seed", str(2**60)), "seed 1152921504606846976 is outside"),
        (("--episodes", "0"), "episodes 0 is outside"),
        (("--episodes", "many"), "--episodes"),
        (("--no-such-option",), "--no-such-option"),
    ],
)
def test_a_demo_of_what_cannot_be_is_refused_before_anything_starts(
    tmp_path: Path, arguments: tuple[str, ...], named: str
) -> None:
    data = tmp_path / "data"
    assert named in refused("demo", "--no-viewer", "--data", str(data), *arguments)
    assert not data.exists()


@pytest.mark.parametrize(
    "arguments, line",
    [
        (
            "teach scripted --session s1 -f label_error=1.2",
            "label_error 1.2 is outside [0, 1]: the default is 0",
        ),
        ("teach scripted --session s1 -f silence_wrong=nan", "silence_wrong nan is outside [0, 1]"),
        ("teach scripted --session s1 -f silence=often", "silence 'often' is no number: give one in [0, 1]"),
        ("teach scripted --session s1 -f delay_min_ms=900", "delay_min_ms 900 is above delay_max_ms 800"),
        ("teach crowd --session s1 --mix good@1.2:3", "an accuracy is a number from 0 to 1"),
        ("teach crowd --session s1 --mix good:0.3,random:0.9", "is not KIND:COUNT or KIND@ACCURACY:COUNT"),
        ("experiment crowd --seeds 2 --mix good@-1:3", "is not KIND:COUNT or KIND@ACCURACY:COUNT"),
        ("experiment session --seeds 2 -p explore=1.5", "explore 1.5 is outside [0, 1]"),
        ("experiment session --seeds 2 --method isabl -p error=0.7", "error 0.7 is outside [1e-09, 0.5)"),
        ("session create s1 --method sabl -p praise_silence=1", "praise_silence 1.0 is outside (0, 1)"),
        ("session create s1 --method advise -p consistency=1", "consistency 1.0 is outside [0.5, 1)"),
        ("crowd aggregate none.csv --abstain-below 2", "abstain_below 2.0 is outside 0 to 1"),
    ],
)
def test_a_probability_that_cannot_be_one_is_refused_wherever_it_is_given(arguments: str, line: str) -> None:
    assert line in refused(*arguments.split())


@pytest.mark.parametrize(
    "arguments, named",
    [
        (("sorcery",), "No such command 'sorcery': `sfid --help` shows what there is"),
        (("session", "show"), "Missing argument 'name': `sfid session show --help` shows what there is"),
        (
            ("session", "list", "--state", "odd"),
            "Invalid value for '--state': 'odd' is not one of 'gathering'",
        ),
        (("session", "create", "s1", "-p", "alpha=1.5"), "alpha 1.5 is outside"),
        (("session", "create", "s1", "-p", "gamma=1"), "gamma 1.0 is outside"),
        (("session", "create", "s1", "--window-ms", "0"), "window span 0 ms is outside"),
        (("session", "create", "s1", "--window-mode", "slow"), "unknown window mode 'slow'"),
        (("session", "create", "s1", "--teachers-min", "5000"), "teachers_min"),
        (("session", "create", "S 1"), "session name 'S 1' is not allowed"),
        (("session", "stop", "a*"), "session name 'a*' is not allowed"),
        (("session", "show", ""), "session name '' is not allowed"),
        (("session", "list", "--connect", "here"), "endpoint 'here'"),
        (("environment", "--deployment", "My Lab"), "deployment name 'My Lab'"),
        (("router", "--listen", "tcp/0.0.0.0:7447"), "--insecure-bind"),
        (("replay", "nowhere"), "nowhere"),
    ],
)
def test_bad_usage_is_one_line(arguments: tuple[str, ...], named: str) -> None:
    assert named in refused(*arguments)


def test_a_wrong_key_in_the_configuration_is_named_with_the_keys_there_are(tmp_path: Path) -> None:
    config = tmp_path / "sfid.toml"
    config.write_text('dta = "here"\n')
    line = refused("up", "--config", str(config))
    assert str(config) in line
    assert "unknown key dta: correct its name, or take it out" in line
    assert "known keys are data, listen" in line


def test_a_data_directory_below_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    below = str(tmp_path / "file" / "data")
    for command in (("demo", "--no-viewer"), ("up",)):
        line = refused(*command, "--data", below)
        assert below in line
        assert "name a --data directory that can be written" in line


def test_a_taken_port_and_a_locked_directory_are_refused_by_name(tmp_path: Path) -> None:
    endpoint, data = free_endpoint(), tmp_path / "data"
    errors = tmp_path / "router.log"
    with running("router", "--listen", endpoint, stderr=errors) as router, Shard.open(data):
        wait_for("router", lambda: "ready" in errors.read_text())
        taken = f"sfid: cannot listen at {endpoint}: another program has it"
        assert refused("router", "--listen", endpoint).startswith(taken)
        assert refused("up", "--listen", endpoint, "--data", str(tmp_path / "up")).startswith(taken)
        locked = refused("learner", "--connect", endpoint, "--data", str(data))
        assert str(data) in locked
        assert refused("demo", "--no-viewer", "--data", str(data)) == locked
        router.terminate()
        assert router.wait(DRAIN_MAX_S) == 0
