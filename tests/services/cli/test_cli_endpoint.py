"""Which router a command talks to."""

import os
import subprocess
import sys

import pytest

from services.router import free_endpoint

pytestmark = pytest.mark.real


@pytest.mark.parametrize("said", ["in the environment", "as an option"])
def test_the_router_is_named_in_the_environment_unless_an_option_says_another(said: str) -> None:
    named, other = free_endpoint(), "tcp/127.0.0.1:1"
    command = [sys.executable, "-P", "-m", "services.cli.main", "health", "router"]
    option, variable = ([], named) if said == "in the environment" else (["--connect", named], other)
    environment = {**os.environ, "SFID_CONNECT": variable}
    done = subprocess.run([*command, *option], capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith(f"sfid: no router at {named}: ")
