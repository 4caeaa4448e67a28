"""Which outlines are of rooms and walls, and which of noise and of legs of chairs."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.geometry import Geometries, rectangle_sides
from sgraph_core.grid.outlines import enclosed_area
from sgraph_core.grid.settings import SurfaceSettings

__all__ = ["without_clutter"]

THIN = 1.5
"""A piece of a broken wall is more than this many times as long as wide..."""
IN_LINE = 4.0
"""...and two of them together more than this many times."""
PART_POINTS = 64
"""Outlines are cut into parts of so many points, lest all of a large one is asked what is near."""


def without_clutter(
    lines: list[FloatArray], settings: SurfaceSettings, cell_m: float
) -> list[FloatArray]:
    """Return the outlines without those of small free spaces, and in them, and of lone blobs.

    Args:
        lines: outlines in cells, free space on the right.
        settings: what is small.
        cell_m: side of a cell, in metres.
    """
    if not lines:
        return lines
    shapes = np.array([shapely.linestrings(line) for line in lines])
    areas = np.array([enclosed_area(line) for line in lines]) * cell_m**2
    drop = (areas < 0) & (areas > -settings.smallest_free_m2)
    rings = [shapely.Polygon(lines[n]) for n in np.flatnonzero(drop)]
    inside, _ = shapely.STRtree(rings).query(shapes, predicate="covered_by")
    drop[inside] = True
    small = _extents(_boxes(shapes)) * cell_m < settings.smallest_blob_m
    blobs = np.flatnonzero((areas > 0) & small & ~drop)
    if len(blobs):
        one, two = _links(lines, shapes, blobs, settings, cell_m)
        drop[_lone(_boxes(shapes), blobs, one, two, settings.smallest_blob_m / cell_m)] = True
    return [line for line, dropped in zip(lines, drop.tolist(), strict=True) if not dropped]


def _lone(
    boxes: FloatArray, blobs: IntArray, one: IntArray, two: IntArray, smallest: float
) -> IntArray:
    """Return which blobs stay small even together with all that they hang together with."""
    while True:
        grown = boxes.copy()
        np.maximum.at(grown, one, boxes[two])
        small = _extents(grown) < smallest
        if (grown == boxes)[small].all():
            return np.asarray(blobs[small[blobs]])
        boxes = grown


def _links(
    lines: list[FloatArray],
    shapes: Geometries,
    blobs: IntArray,
    settings: SurfaceSettings,
    cell_m: float,
) -> tuple[IntArray, IntArray]:
    """Return which small blobs hang together with what.

    Those that are close do. Walls may be broken into thin pieces, so of what is close to something
    large only thin ones do, since others are things at a wall; and thin ones in line need not be
    as close.
    """
    parts, owner = _parts(lines)
    near, part = shapely.STRtree(parts).query(
        shapes[blobs], predicate="dwithin", distance=settings.widest_gap_m / cell_m
    )
    one, two = blobs[near], owner[part]
    small, thin = np.zeros(len(shapes), bool), np.zeros(len(shapes), bool)
    small[blobs], thin[blobs] = True, _elongated(shapes[blobs], THIN)
    close = shapely.distance(shapes[one], parts[part]) * cell_m <= settings.lone_gap_m
    linked = close & (small[two] | thin[one])
    apart = np.flatnonzero(~close & thin[one] & thin[two])
    linked[apart] = _elongated(shapely.union(shapes[one[apart]], shapes[two[apart]]), IN_LINE)
    return one[linked], two[linked]


def _parts(lines: list[FloatArray]) -> tuple[Geometries, IntArray]:
    """Return short parts of outlines and the outline that each part is of, [P] each."""
    parts, owner = [], []
    for n, line in enumerate(lines):
        starts = range(0, len(line) - 1, PART_POINTS)
        parts += [shapely.LineString(line[start : start + PART_POINTS + 1]) for start in starts]
        owner += [n] * len(starts)
    return np.array(parts), np.array(owner)


def _boxes(shapes: Geometries) -> FloatArray:
    """Return -min x, -min y, max x, max y: the box of a union is the largest of each, [N, 4]."""
    return np.asarray(shapely.bounds(shapes) * [-1, -1, 1, 1])


def _extents(boxes: FloatArray) -> FloatArray:
    return np.asarray((boxes[:, 2:] + boxes[:, :2]).max(axis=1))


def _elongated(shapes: Geometries, ratio: float) -> NDArray[np.bool_]:
    """Return which shapes with an area are more than so many times as long as wide, [N]."""
    width, length = rectangle_sides(shapes).T
    return np.asarray(length > ratio * width)
