"""Where the space between surfaces can be closed: gaps in walls, and walls that end too early.

A doorway is a gap between collinear surfaces. Where a surface is missing, or rooms open into one
another without a door, a wall ends in the open; continued straight on it meets the next surface.
Both closures are as likely to be a border of a room as they are short.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.geometry import TIE_M, boxes_of, cross, dot, lines_of, nearest, points_of

__all__ = ["Closures", "continuations", "gaps"]

GAP_ANGLE_RAD = np.radians(15.0)
GAP_OFFSET_M = 0.12
GAP_SLOPE = 0.05
"""Surfaces count as collinear over a gap when they are within 15 degrees, and offset by at most
12 cm and 5 % of the gap."""

CORNER_M = 0.25
CORNER_SINE = 0.3
"""An end is part of a corner when a surface that turns by over 17 degrees comes this close."""
MEETS_SINE = 0.2
"""A continued surface ends at surfaces that it meets at over 12 degrees."""
CLEARANCE_M = 0.02
"""A surface is continued from this far beyond its end, clear of what it touches there."""


@dataclass(frozen=True, eq=False)
class Closures:
    """Segments [C, 2, 2] that close a space, and their lengths in metres [C]."""

    segments: FloatArray
    widths: FloatArray


def gaps(surfaces: SurfaceArrays, widest_m: float, rows: IntArray | None = None) -> Closures:
    """Return the gaps from each surface's second end to the next collinear surface's first.

    Args:
        surfaces: N surfaces.
        widest_m: wider gaps are left out.
        rows: of the surfaces whose gaps are wanted; all if not given.
    """
    rows = np.arange(len(surfaces)) if rows is None else rows
    ends, starts = surfaces.segments[:, 1], surfaces.segments[:, 0]
    tree = shapely.STRtree(points_of(starts))
    # a gap runs at half their angle to the surfaces that it joins, or less
    farthest = ends[rows] + widest_m * surfaces.tangents[rows]
    aside = GAP_OFFSET_M + (GAP_SLOPE + np.sin(GAP_ANGLE_RAD / 2)) * widest_m
    one, two = tree.query(boxes_of(np.stack([ends[rows], farthest], axis=1), aside))
    one = rows[one]
    same_way = dot(surfaces.normals[one], surfaces.normals[two]) > np.cos(GAP_ANGLE_RAD)
    one, two = one[same_way], two[same_way]
    gap = starts[two] - ends[one]
    tangent = surfaces.tangents[one] + surfaces.tangents[two]
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    width = dot(gap, tangent)
    collinear = (width > 0) & (np.abs(cross(gap, tangent)) < GAP_OFFSET_M + GAP_SLOPE * width)
    collinear &= (one != two) & (dot(gap, gap) <= widest_m**2)
    one, two, width = one[collinear], two[collinear], width[collinear]
    next_one = nearest(one, width, 1)
    one, two, width = one[next_one], two[next_one], width[next_one]
    return Closures(np.stack([ends[one], starts[two]], axis=1), width)


def continuations(
    surfaces: SurfaceArrays, longest_m: float, rows: IntArray | None = None
) -> Closures:
    """Return the continuations of surfaces that end in no corner, up to the next surface.

    Args:
        surfaces: N surfaces.
        longest_m: longer continuations are left out.
        rows: of the surfaces whose continuations are wanted; all if not given.
    """
    rows = np.arange(len(surfaces)) if rows is None else rows
    lines = lines_of(surfaces.segments)
    tree = shapely.STRtree(lines)
    own = np.tile(rows, 2)
    ends = surfaces.segments[rows, ::-1].swapaxes(0, 1).reshape(-1, 2)
    outwards = np.concatenate([surfaces.tangents[rows], -surfaces.tangents[rows]])

    # testing what the boxes leave is faster than a query with the predicate "dwithin"
    end, near = tree.query(boxes_of(ends[:, None], CORNER_M + TIE_M))
    turns = np.abs(cross(outwards[end], surfaces.tangents[near])) >= CORNER_SINE
    turns &= near != own[end]
    end, near = end[turns], near[turns]
    corner = shapely.dwithin(points_of(ends[end]), lines[near], CORNER_M)
    free = np.flatnonzero(np.bincount(end[corner], minlength=len(ends)) == 0)

    starts = ends[free] + CLEARANCE_M * outwards[free]
    reach = (longest_m - CLEARANCE_M) * outwards[free]
    rays = lines_of(np.stack([starts, starts + reach], axis=1))
    ray, met = tree.query(rays, predicate="intersects")
    along = surfaces.segments[met, 1] - surfaces.segments[met, 0]
    sine = cross(outwards[free[ray]], surfaces.tangents[met])
    meets = (met != own[free[ray]]) & (np.abs(sine) > MEETS_SINE)
    ray, met, along = ray[meets], met[meets], along[meets]
    direction = outwards[free[ray]]
    to_met = surfaces.segments[met, 0] - starts[ray]
    width = CLEARANCE_M + cross(to_met, along) / cross(direction, along)
    first = nearest(ray, width, 1)
    ray, width, direction = ray[first], width[first], direction[first]
    start = ends[free[ray]]
    return Closures(np.stack([start, start + width[:, None] * direction], axis=1), width)
