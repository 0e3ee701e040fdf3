"""`sfid up` with a learner, a crowd and its page: what tests of crowds over real processes start from."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from services.router import free_endpoint
from tests.services.cli.command_line import running


@contextmanager
def crowd_up(data: Path) -> Iterator[str]:
    """Yield the endpoint of the running services; its members use the deployment local-crowd."""
    endpoint = free_endpoint()
    settings = data / "up.toml"
    settings.write_text(
        f"""data = "{data}"
listen = "{endpoint}"
[monitor]
enabled = false
[gateway]
enabled = true
crowd = true
listen = "127.0.0.1:0"
[aggregator]
enabled = true
"""
    )
    with running("up", "--config", str(settings), stderr=data / "up.log") as up:
        assert up.stdout is not None
        lines: list[str] = []
        while not (lines and lines[-1].startswith("next: ")):
            lines.append(up.stdout.readline())
            assert lines[-1], (data / "up.log").read_text()
        assert any(line.startswith("members of the crowd teach with `sfid teach keyboard") for line in lines)
        yield endpoint
        up.terminate()
        up.wait(30)
