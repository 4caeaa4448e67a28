"""`sgraph evaluate` on occupancy grids."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from sgraph_cli.console import print_markdown, progress, warnings_as_notes

if TYPE_CHECKING:
    from sgraph_core.detector import Detector
    from sgraph_core.evaluation.grids import Found, LabelledGrid

__all__ = ["Classic", "evaluate_grids", "print_grid_scores"]


class Classic(StrEnum):
    """Algorithms to compare with, which segment the free space of a grid."""

    watershed = "watershed"


COLUMNS = {
    "map": "map",
    "surface_recall": "surfaces R",
    "surface_precision": "P",
    "room_precision_50": "rooms P .5",
    "room_recall_50": "R .5",
    "room_f1_50": "F1 .5",
    "room_precision_70": "P .7",
    "room_recall_70": "R .7",
    "room_f1_70": "F1 .7",
    "mean_iou": "mean IoU",
    "seconds": "s",
}
"""Titles of the table's columns, by key of the record that fills them."""


def evaluate_grids(
    grids: Sequence[LabelledGrid], detector: Detector | None, plots: Path | None
) -> list[dict[str, float | str]]:
    """Return a record per map and per kind of map.

    Args:
        grids: the maps.
        detector: what finds rooms; None for the watershed.
        plots: folder to write a picture of every map to.
    """
    from sgraph_core.evaluation.grid_pictures import save_picture
    from sgraph_core.evaluation.grids import as_rows, evaluate
    from sgraph_core.evaluation.watershed import watershed_rooms

    if plots is not None:
        plots.mkdir(parents=True, exist_ok=True)

    def show(labelled: LabelledGrid, found: Found) -> None:
        if plots is not None:
            save_picture(found, plots / f"{labelled.name}.png")

    with progress() as report, warnings_as_notes():
        return as_rows(evaluate(grids, detector or watershed_rooms, report, show))


def print_grid_scores(rows: Sequence[Mapping[str, float | str]]) -> None:
    """Print a table of the maps' scores, a line per record."""
    print_markdown(COLUMNS.values(), ([cell(row[k]) for k in COLUMNS] for row in rows), named=True)


def cell(value: float | str) -> str:
    """Return a number as a table shows it: nothing for NaN."""
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.3f}"
    return str(value)
