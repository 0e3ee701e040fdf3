"""Warnings about a configuration that is allowed and seldom meant, on stderr."""

import sys

from sfid_core.session.config import SessionConfig
from sfid_core.session.warnings import circuit_warnings


def warn(*configs: SessionConfig, scale: float | None = None, sets_parameters: bool = True) -> None:
    """Print every warning about these sessions once, one line each; see `circuit_warnings` for the rest."""
    found = (circuit_warnings(one, scale=scale, sets_parameters=sets_parameters) for one in configs)
    for line in dict.fromkeys(line for lines in found for line in lines):
        print(f"warning: {line}", file=sys.stderr)
