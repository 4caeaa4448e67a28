"""`sgraph evaluate`: scores against the truth that maps carry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from sgraph_cli.arguments import (
    Clusterers,
    Scorer,
    ScorerName,
    Weights,
    make_detector,
    refuse_beside,
    warn_about_lists,
)
from sgraph_cli.console import print_table, progress

__all__ = ["evaluate", "print_scores"]


def evaluate(
    paths: Annotated[
        list[Path], typer.Argument(metavar="PATH...", help="Map files with truth, or folders.")
    ],
    stored: Annotated[
        bool, typer.Option("--stored", help="Score what the files hold instead of inferring anew.")
    ] = False,
    scorer: Scorer = ScorerName.network,
    weights: Weights = None,
    clusterer: Clusterers = None,
    trajectory: Annotated[
        Path | None,
        typer.Option(help="Reference trajectory (TUM format) to compare the keyframes with."),
    ] = None,
    only: Annotated[
        list[Path] | None,
        typer.Option(help="Only the maps that this text file names; a source of its own."),
    ] = None,
    uncalibrated: Annotated[
        bool, typer.Option("--uncalibrated", help="Take nodes' confidences from the clusterers.")
    ] = False,
    reliability: Annotated[
        Path | None,
        typer.Option(help="Write a reliability diagram of nodes and edges (.png, .svg or .pdf)."),
    ] = None,
    per_floor: Annotated[
        bool, typer.Option("--per-floor", help="A row for every map instead of every source.")
    ] = False,
    json_: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Print precision, recall, F1 and calibration of rooms and walls, per source.

    Every PATH is a source; with --only, which may be repeated, every list's part of every PATH.
    """
    detector = None
    if stored:
        rules = scorer is ScorerName.baseline
        inference = {"--scorer": rules, "--weights": weights, "--clusterer": clusterer}
        refuse_beside("--stored", {**inference, "--uncalibrated": uncalibrated})
    else:
        detector = make_detector(scorer, weights, clusterer, calibrated=not uncalibrated)
    from sgraph_core.evaluation.report import SourceReport, as_rows
    from sgraph_core.evaluation.report import evaluate as run
    from sgraph_core.evaluation.trajectory import read_tum
    from sgraph_core.plotting import check_name

    if reliability is not None:
        check_name(reliability)
    warn_about_lists(paths, only or [])
    reference = None if trajectory is None else read_tum(trajectory)
    with progress() as report:
        reports = run(paths, detector, reference, report, only or [])
    if reliability is not None:
        from sgraph_core.evaluation.reliability_diagram import draw_reliability

        draw_reliability(reports, reliability)
    if per_floor:
        reports = [SourceReport(f.name, (f,)) for source in reports for f in source.floors]
    rows = as_rows(reports)
    if json_:
        import json

        typer.echo(json.dumps([_without_nan(row) for row in rows], indent=1))
    else:
        print_scores(rows)


def _without_nan(row: dict[str, float | int | str]) -> dict[str, float | int | str | None]:
    """Replace NaN, which JSON does not know, by null."""
    return {
        key: None if isinstance(value, float) and math.isnan(value) else value
        for key, value in row.items()
    }


COLUMNS = {
    "source": "source",
    "floors": "floors",
    "room_precision": "rooms P",
    "room_recall": "R",
    "room_f1": "F1",
    "room_f1_mean": "mean F1",
    "room_exact_f1": "exact F1",
    "room_ece": "room ECE",
    "rooms_left_out": "left out",
    "wall_precision": "walls P",
    "wall_recall": "R",
    "wall_f1": "F1",
    "wall_f1_mean": "mean F1",
    "wall_ece": "wall ECE",
    "walls_left_out": "left out",
    "seconds_per_floor": "s / floor",
    "ate_m": "ATE [m]",
}
"""Titles of the table's columns, by key of the record that fills them."""


def print_scores(rows: Sequence[dict[str, float | int | str]]) -> None:
    """Print a table of rooms and walls, a line per record."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.MARKDOWN)
    for key, title in COLUMNS.items():
        table.add_column(title, justify="left" if key == "source" else "right")
    for row in rows:
        table.add_row(*(_cell(row[key]) for key in COLUMNS))
    print_table(table)


def _cell(value: float | int | str) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.3f}"
    return str(value)
