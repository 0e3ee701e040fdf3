"""Warnings about a configuration that is allowed and seldom meant, on stderr."""

import sys

from sfid_core.session.config import SessionConfig
from sfid_core.session.warnings import circuit_warnings


def warn(*configs: SessionConfig) -> None:
    """Print every warning about these sessions once, one line each."""
    for line in dict.fromkeys(line for config in configs for line in circuit_warnings(config)):
        print(f"warning: {line}", file=sys.stderr)
