"""`sgraph ablate`: what each part of the method brings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sgraph_cli.commands.evaluate import print_scores
from sgraph_cli.console import progress, warn_about_plugins

__all__ = ["ablate"]


def ablate(
    paths: Annotated[
        list[Path], typer.Argument(metavar="PATH...", help="Map files with truth, or folders.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder for the trainings; it may hold some.")
    ],
    floors: Annotated[int, typer.Option(min=1, help="Floors of each training.")] = 500,
    steps: Annotated[int, typer.Option(min=1, help="Steps of each training.")] = 300,
    seed: Annotated[int, typer.Option(min=0, help="Of each training.")] = 0,
) -> None:
    """Train the network with one part changed at a time, and print each one's scores.

    The same command goes on with an interrupted run.
    """
    from sgraph_core.concepts import installed
    from sgraph_core.evaluation.report import as_rows
    from sgraph_core.training.ablation import ablate as run
    from sgraph_core.training.config import TrainingConfig

    base = TrainingConfig(seed=seed, floors=floors, validation_floors=20, steps=steps)
    registry = installed()
    warn_about_plugins(list(registry.problems))
    rows = []
    with progress() as report:
        for variant, reports in run(base, paths, output, registry, report):
            for row in as_rows(reports):
                rows.append({**row, "source": f"{variant}: {row['source']}"})
    print_scores(rows)
