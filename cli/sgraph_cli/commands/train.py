"""`sgraph train`: weights from synthetic buildings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sgraph_cli.console import note, progress, warn_about_plugins

__all__ = ["train"]


def train(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for weights and record.")],
    config: Annotated[
        str | None,
        typer.Option(
            metavar="FILE|paper",
            help="JSON file with the run's settings (docs/training.md), or the paper's.",
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Instead of the settings' one.")] = None,
    floors: Annotated[
        int | None, typer.Option(min=1, help="Training floors, instead of the settings'.")
    ] = None,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Length of the schedule, instead of the settings'.")
    ] = None,
    stop: Annotated[
        int | None, typer.Option(min=1, help="Stop after this step of the schedule.")
    ] = None,
    concept: Annotated[
        str | None,
        typer.Option(help="Train this concept's head alone, on the shipped encoder."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the interrupted run in the folder.")
    ] = False,
) -> None:
    """Train encoder and heads on synthetic buildings.

    An interrupted run goes on with --resume, and ends with the same weights; a run that has stopped
    goes on to a later --stop.
    """
    from sgraph_core.concepts import installed
    from sgraph_core.settings import read_settings
    from sgraph_core.training.config import TrainingConfig, config_file
    from sgraph_core.training.trainer import train as run

    given = {"seed": seed, "floors": floors, "steps": steps, "stop": stop}
    settings = read_settings(config_file(config), TrainingConfig)
    changed = {name: value for name, value in given.items() if value is not None}
    settings = TrainingConfig.model_validate({**settings.model_dump(), **changed})
    registry = installed()
    warn_about_plugins(list(registry.problems))
    try:
        with progress() as report:
            record = run(
                settings, output, registry, concept=concept, resume=resume, progress=report
            )
    except KeyboardInterrupt:
        note(f"sgraph: interrupted: the same command with --resume goes on in {output}")
        raise typer.Exit(130) from None
    last = record["history"][-1]
    losses = ", ".join(f"{name} {value:.4f}" for name, value in last.items() if name != "step")
    note(f"wrote weights of {', '.join(record['concepts'])} to {output}; losses: {losses}")
