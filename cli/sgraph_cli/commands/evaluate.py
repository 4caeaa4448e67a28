"""`sgraph evaluate`: scores against the truth that maps carry."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sgraph_cli.arguments import ScorerName, Weights, by_concept
from sgraph_cli.console import print_table, progress, warn_about_plugins

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sgraph_core.evaluation.report import SourceReport

__all__ = ["evaluate"]


def evaluate(
    paths: Annotated[
        list[Path], typer.Argument(metavar="PATH...", help="Map files with truth, or folders.")
    ],
    stored: Annotated[
        bool, typer.Option("--stored", help="Score what the files hold instead of inferring anew.")
    ] = False,
    scorer: Annotated[
        ScorerName, typer.Option(help="The trained network, or the rules without learning.")
    ] = ScorerName.network,
    weights: Weights = None,
    clusterer: Annotated[
        list[str] | None,
        typer.Option(metavar="CONCEPT=NAME", help="Another clusterer, such as room=cycles."),
    ] = None,
    trajectory: Annotated[
        Path | None,
        typer.Option(help="Reference trajectory (TUM format) to compare the keyframes with."),
    ] = None,
    per_floor: Annotated[
        bool, typer.Option("--per-floor", help="A row for every map instead of every source.")
    ] = False,
    json_: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Print precision, recall and F1 of rooms and walls, per folder (pooled and mean of floors)."""
    clusterers = by_concept(clusterer or [], "--clusterer")
    from sgraph_core.detector import Detector
    from sgraph_core.evaluation.report import SourceReport, as_rows
    from sgraph_core.evaluation.report import evaluate as run
    from sgraph_core.evaluation.trajectory import read_tum

    detector = (
        None if stored else Detector(scorer=scorer.value, clusterers=clusterers, weights=weights)
    )
    if detector is not None:
        warn_about_plugins(list(detector.registry.problems))
    reference = None if trajectory is None else read_tum(trajectory)
    with progress() as report:
        reports = run(paths, detector, reference, report)
    if per_floor:
        reports = [SourceReport(f.name, (f,)) for source in reports for f in source.floors]
    if json_:
        import json

        rows = as_rows(reports)
        typer.echo(json.dumps([_without_nan(row) for row in rows], indent=1))
    else:
        print_scores(reports)


def _without_nan(row: dict[str, float | int | str]) -> dict[str, float | int | str | None]:
    """Replace NaN, which JSON does not know, by null."""
    return {
        key: None if isinstance(value, float) and math.isnan(value) else value
        for key, value in row.items()
    }


def print_scores(reports: Sequence[SourceReport]) -> None:
    """Print a table of rooms and walls."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.MARKDOWN)
    table.add_column("source")
    for column in (
        "floors",
        "rooms P", "R", "F1", "mean F1", "exact F1", "left out",
        "walls P", "R", "F1", "mean F1", "left out",
        "s / floor", "ATE [m]",
    ):  # fmt: skip
        table.add_column(column, justify="right")
    for report in reports:
        rooms, walls = report.rooms, report.walls
        scores = (rooms.precision, rooms.recall, rooms.f1, report.mean_room_f1)
        wall_scores = (walls.precision, walls.recall, walls.f1, report.mean_wall_f1)
        table.add_row(
            report.source,
            str(len(report.floors)),
            *(f"{score:.3f}" for score in (*scores, report.exact_rooms.f1)),
            str(rooms.left_out),
            *(f"{score:.3f}" for score in wall_scores),
            str(walls.left_out),
            *(
                "" if math.isnan(value) else f"{value:.3f}"
                for value in (report.median_seconds, report.mean_ate_m)
            ),
        )
    print_table(table)
