"""`sfid experiment`: the experiments as one group of commands."""

import typer

from services.cli.experiment import circuits, crowd, figure2, guidance, learners, session

experiment_app = typer.Typer(
    help="Compare methods and teachers over many seeds.", no_args_is_help=True, rich_markup_mode=None
)


def add_to(app: typer.Typer) -> None:
    """Add the experiments."""
    for one in (figure2, session, learners, guidance, circuits, crowd):
        one.add_to(experiment_app)
    app.add_typer(experiment_app, name="experiment")
