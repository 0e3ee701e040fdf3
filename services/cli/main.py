"""`sfid`: assembles the commands and turns every failure into one line and an exit code."""

import os
import sys
from typing import Annotated, NoReturn

import typer
from typer.exceptions import TyperException

from protocol.codec import DecodeError
from protocol.keys import KeyNameError
from services.cli import (
    aggregate,
    backup,
    catalogue,
    crowd,
    demo,
    doctor,
    export,
    forget,
    gateway,
    journal,
    keys,
    levels,
    metrics,
    serve,
    session,
    simulate,
    status,
    study,
    teach,
    up,
)
from services.cli.experiment import group as experiment
from services.cli.shared.failure import BAD_USAGE, CommandError
from services.client import TeachingError
from services.router import RouterError
from services.runtime.bus import BusError
from services.runtime.journal import JournalError
from services.runtime.log_config import LEVEL_VARIABLE, VARIABLE, LogFormat, LogLevel, choose
from services.runtime.secret import SecretError
from services.supervisor import SupervisorError
from sfid_core.experiments.errors import ExperimentError
from sfid_core.learning.parameters import ParameterError
from sfid_core.sokoban.levels import LevelError
from sfid_core.sokoban.starts import WorldError

INTERRUPTED = 130

app = typer.Typer(
    name="sfid",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


@app.callback()
def common(
    log_format: Annotated[
        LogFormat | None,
        typer.Option(envvar=VARIABLE, help="How services log, this one and those that it starts."),
    ] = None,
    log_level: Annotated[
        LogLevel | None, typer.Option(envvar=LEVEL_VARIABLE, help="From which importance on they log.")
    ] = None,
) -> None:
    """Teach a reinforcement-learning agent live.

    Say which action you would take, and agreement becomes its reward.
    """
    choose(log_format, log_level)


for group in (
    demo,
    doctor,
    up,
    serve,
    aggregate,
    gateway,
    teach,
    session,
    journal,
    keys,
    backup,
    forget,
    levels,
    metrics,
    catalogue,
    crowd,
    experiment,
    export,
    simulate,
    status,
    study,
):
    group.add_to(app)


def main() -> None:
    """Run one command; exit 0 ok, 1 not so, 2 bad usage or configuration."""
    try:
        code = app(standalone_mode=False)
    except CommandError as error:
        _fail(str(error), error.exit_code)
    except SupervisorError as error:
        _fail(str(error), error.exit_code)
    except (
        DecodeError,
        KeyNameError,
        BusError,
        JournalError,
        RouterError,
        SecretError,
        ParameterError,
        LevelError,
        WorldError,
        TeachingError,
        ExperimentError,
    ) as error:
        _fail(str(error), BAD_USAGE)
    except TyperException as error:
        said = error.format_message()
        if said.startswith("Usage:"):  # a group without a command: its help, as it is laid out
            print(said, file=sys.stderr, flush=True)
            sys.exit(BAD_USAGE)
        _fail(
            f"{said.replace('Value error, ', '').rstrip('.')}: {_help_of(error)} shows what there is",
            BAD_USAGE,
        )
    except (KeyboardInterrupt, typer.Abort):
        sys.exit(INTERRUPTED)
    except BrokenPipeError:  # `sfid ... | head`: what is still buffered has nowhere to go
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    sys.exit(code or 0)


def _help_of(error: TyperException) -> str:
    """Return what explains the command that was not understood."""
    context = getattr(error, "ctx", None)
    return f"`{'sfid' if context is None else context.command_path} --help`"


def _fail(message: str, code: int) -> NoReturn:
    """Say it in one line and leave; an empty message has been said by a child process."""
    sys.stdout.flush()
    if message:
        print(f"sfid: {' '.join(message.split())}", file=sys.stderr, flush=True)
    sys.exit(code)


if __name__ == "__main__":
    main()
