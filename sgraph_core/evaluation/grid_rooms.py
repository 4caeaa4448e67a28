"""How well rooms painted on an occupancy grid match labelled ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgraph_core.evaluation.scores import Counts, matched_rows

__all__ = ["LEAST_IOU", "RoomScore", "score_rooms"]

SMALLEST_M2 = 1.0
"""Rooms of less than this are dropped on both sides."""
LEAST_IOU = (0.5, 0.7)
"""Intersections over union from which a painted room matches a true one."""


@dataclass(frozen=True)
class RoomScore:
    """Scores of the rooms of one map.

    Attributes:
        loose: matched at an intersection over union of 0.5 or more.
        strict: at 0.7 or more.
        mean_iou: of those matched at 0.5, NaN without any.
    """

    loose: Counts
    strict: Counts
    mean_iou: float


def score_rooms(
    painted: NDArray[np.integer], true: NDArray[np.integer], cell_m2: float
) -> RoomScore:
    """Compare rooms painted on a grid with the true ones, one to one, most matches first.

    Args:
        painted: number of the room of each cell, -1 for none, [H, W].
        true: likewise.
        cell_m2: area of a cell.
    """
    overlap = _overlaps(painted, true)
    sizes = overlap.sum(axis=1), overlap.sum(axis=0)
    kept, wanted = (size[1:] * cell_m2 >= SMALLEST_M2 for size in sizes)
    union = np.maximum(sizes[0][1:, None] + sizes[1][1:] - overlap[1:, 1:], 1)
    iou = (overlap[1:, 1:] / union)[np.ix_(kept, wanted)]
    loose, strict = (matched_rows(iou >= least) for least in LEAST_IOU)
    best = iou.max(axis=1, initial=0.0)[loose]
    return RoomScore(
        Counts(int(loose.sum()), *iou.shape),
        Counts(int(strict.sum()), *iou.shape),
        float(best.mean()) if len(best) else float("nan"),
    )


def _overlaps(one: NDArray[np.integer], two: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return in how many cells values meet; the first row and column are those of value -1."""
    rows, columns = ([-1, *np.unique(values[values >= 0]).tolist()] for values in (one, two))
    row, column = np.searchsorted(rows, one), np.searchsorted(columns, two)
    table = np.bincount((row * len(columns) + column).ravel(), minlength=len(rows) * len(columns))
    return table.reshape(len(rows), len(columns))
