"""`sgraph evaluate`: scores against the truth that maps carry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sgraph_cli.arguments import (
    Clusterers,
    Scorer,
    ScorerName,
    Weights,
    make_detector,
    refuse_beside,
    warn_about_absent,
    warn_about_lists,
)
from sgraph_cli.console import print_markdown, progress
from sgraph_cli.grid_scores import Classic, cell, evaluate_grids, print_grid_scores

if TYPE_CHECKING:
    from sgraph_core.detector import Detector
    from sgraph_core.evaluation.grids import LabelledGrid

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
    truth: Annotated[
        Path | None,
        typer.Option(help="Labelled rooms of the one grid; by default rooms.png beside its YAML."),
    ] = None,
    classic: Annotated[
        Classic | None,
        typer.Option(help="Score this algorithm on grids instead, which needs no detector."),
    ] = None,
    plots: Annotated[
        Path | None,
        typer.Option(help="Write a picture of every grid with its rooms to this folder."),
    ] = None,
    json_: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Print precision, recall, F1 and calibration of rooms and walls, per source.

    Every PATH is a source; with --only, which may be repeated, every list's part of every PATH.
    Occupancy grids (a YAML file, its folder, or a folder of such folders) have a table of their
    own: a row for every map, and the mean of every kind of map.
    """
    detector, rules = None, scorer is ScorerName.baseline
    inference = {"--scorer": rules, "--weights": weights, "--clusterer": clusterer}
    for option, given in (("--stored", stored), ("--classic", classic)):
        if given:
            refuse_beside(option, {**inference, "--uncalibrated": uncalibrated})
    if not (stored or classic):
        detector = make_detector(scorer, weights, clusterer, calibrated=not uncalibrated)
    grids, maps = _sorted_by_kind(paths, truth, only or [])
    of_maps = {"--stored": stored, "--trajectory": trajectory, "--reliability": reliability}
    if grids:
        refuse_beside("occupancy grids", {**of_maps, "--per-floor": per_floor})
    if maps:
        refuse_beside(
            "maps of surfaces", {"--classic": classic, "--plots": plots, "--truth": truth}
        )
    grid_rows = evaluate_grids(grids, detector, plots) if grids else []
    rows = _evaluate_maps(maps, detector, trajectory, only or [], reliability, per_floor)
    if json_:
        import json

        typer.echo(json.dumps([_without_nan(row) for row in (*grid_rows, *rows)], indent=1))
        return
    if grid_rows:
        print_grid_scores(grid_rows)
    if rows:
        print_scores(rows)


def _sorted_by_kind(
    paths: Sequence[Path], truth: Path | None, only: Sequence[Path]
) -> tuple[list[LabelledGrid], list[Path]]:
    """Return the occupancy grids that paths name, and the paths that name other maps."""
    from sgraph_core.evaluation.grids import absent_from, find_grids, only_named

    found = [find_grids(path, truth) for path in paths]
    grids = [grid for some in found for grid in some]
    if truth is not None and len(grids) != 1:
        raise typer.BadParameter("needs exactly one occupancy grid", param_hint="--truth")
    maps = [path for path, some in zip(paths, found, strict=True) if not some]
    if not grids:
        return [], maps
    if not maps:
        warn_about_absent(absent_from(grids, only))
    return only_named(grids, only), maps


def _evaluate_maps(
    paths: Sequence[Path],
    detector: Detector | None,
    trajectory: Path | None,
    only: Sequence[Path],
    reliability: Path | None,
    per_floor: bool,
) -> list[dict[str, float | int | str]]:
    if not paths:
        return []
    from sgraph_core.evaluation.report import SourceReport, as_rows
    from sgraph_core.evaluation.report import evaluate as run
    from sgraph_core.evaluation.trajectory import read_tum
    from sgraph_core.plotting import check_name

    if reliability is not None:
        check_name(reliability)
    warn_about_lists(paths, only)
    reference = None if trajectory is None else read_tum(trajectory)
    with progress() as report:
        reports = run(paths, detector, reference, report, only)
    if reliability is not None:
        from sgraph_core.evaluation.reliability_diagram import draw_reliability

        draw_reliability(reports, reliability)
    if per_floor:
        reports = [SourceReport(f.name, (f,)) for source in reports for f in source.floors]
    return as_rows(reports)


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
    print_markdown(COLUMNS.values(), ([cell(row[k]) for k in COLUMNS] for row in rows), named=True)
