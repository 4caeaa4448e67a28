"""Where the border of a polygon has no surface: doors, corners out of sight, open sides."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.geometry import dot, lines_of

__all__ = ["DOOR_M", "Opening", "openings", "surfaces_along"]

DOOR_M = 1.4
"""An opening up to this wide between collinear surfaces is a door."""
SHORTEST_M = 0.3
"""What is shorter is no opening: mapped surfaces end a little before their corners."""
REACH_M = 0.3
"""A surface covers the part of the border that it comes this close to."""
SAME_WAY_RAD = np.radians(20.0)
"""It does so only if it faces the inside within this angle."""
THICKEST_WALL_M = 0.7
TOUCH_M = 0.01
"""A gap that comes this close to a corner reaches it."""


@dataclass(frozen=True, eq=False)
class Opening:
    """A connected part of a border that no surface covers.

    Attributes:
        kind: ``door``, up to 1.4 m wide and with surfaces on both sides in one line; ``corner``,
            up to 1.4 m wide elsewhere; ``open side``, anything wider.
        segments: its straight pieces of 0.3 m or more, the inside to their right, [K, 2, 2].
    """

    kind: Literal["door", "corner", "open side"]
    segments: FloatArray

    @property
    def lengths_m(self) -> FloatArray:
        """Lengths of the pieces, [K]."""
        return np.asarray(np.linalg.norm(self.segments[:, 1] - self.segments[:, 0], axis=1))


def openings(polygon: shapely.Polygon, surfaces: SurfaceArrays) -> list[Opening]:
    """Return the openings in the border of a polygon, holes included.

    Args:
        polygon: the space that the surfaces enclose.
        surfaces: N surfaces, in the same coordinates.
    """
    clockwise = orient(polygon, sign=-1.0)  # so that the inside is on the right of every ring
    rings = [clockwise.exterior, *clockwise.interiors]
    return [
        opening for ring in rings for opening in _in_ring(shapely.get_coordinates(ring), surfaces)
    ]


def surfaces_along(opening: Opening, surfaces: SurfaceArrays) -> tuple[IntArray, IntArray]:
    """Return which surfaces lie along an opening for 0.3 m or more.

    Returns:
        Rows of those that face the inside, and of those that face away from it, as the far side of
        a wall does.
    """
    edges = _edges(opening.segments)
    turned = SurfaceArrays(edges.ids, edges.segments[:, ::-1], -edges.normals)
    return _along(edges, surfaces, REACH_M), _along(turned, surfaces, THICKEST_WALL_M)


def _along(edges: SurfaceArrays, surfaces: SurfaceArrays, reach_m: float) -> IntArray:
    _, rows, reached = _covered(edges, surfaces, reach_m)
    length = np.bincount(rows, reached[:, 1] - reached[:, 0], minlength=len(surfaces))
    return np.flatnonzero(length >= SHORTEST_M)


def _edges(segments: FloatArray) -> SurfaceArrays:
    """Return the edges of a border as surfaces that face the inside, which is on their right."""
    along = segments[:, 1] - segments[:, 0]
    along = along / np.linalg.norm(along, axis=1)[:, None]
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return SurfaceArrays(np.arange(len(segments)), segments, normals)


def _covered(
    edges: SurfaceArrays, surfaces: SurfaceArrays, reach_m: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return which edges are covered by which surfaces, and from where to where, [C], [C], [C, 2].

    Positions are counted from an edge's first end, in metres.
    """
    edge_lines, lines = lines_of(edges.segments), lines_of(surfaces.segments)
    bands = shapely.buffer(edge_lines, reach_m, cap_style="flat")
    edge, surface = shapely.STRtree(lines).query(bands, predicate="intersects")
    same_way = dot(edges.normals[edge], surfaces.normals[surface]) > np.cos(SAME_WAY_RAD)
    edge, surface = edge[same_way], surface[same_way]
    inside = shapely.intersection(bands[edge], lines[surface])
    crosses = shapely.length(inside) > 0
    edge, surface, inside = edge[crosses], surface[crosses], inside[crosses]
    ends = [
        shapely.line_locate_point(edge_lines[edge], shapely.get_point(inside, end))
        for end in (0, -1)
    ]
    return edge, surface, np.sort(np.stack(ends, axis=1), axis=1)


def _in_ring(ring: FloatArray, surfaces: SurfaceArrays) -> Iterator[Opening]:
    """Yield the openings of a ring of points, the first repeated at the end, [K + 1, 2]."""
    edges = _edges(np.stack([ring[:-1], ring[1:]], axis=1))
    begins = np.cumsum(edges.lengths) - edges.lengths
    edge, _, reached = _covered(edges, surfaces, REACH_M)
    total = float(edges.lengths.sum())
    for gap in _uncovered((begins[edge, None] + reached).tolist(), total):
        opening = _opening(gap, edges, begins)
        if opening is not None:
            yield opening


def _uncovered(covered: Sequence[tuple[float, float]], total: float) -> list[tuple[float, float]]:
    """Return the parts of a circle of length ``total`` that intervals leave over."""
    gaps, reached = [], 0.0
    for start, end in sorted(covered):
        if start > reached:
            gaps.append((reached, start))
        reached = max(reached, end)
    if reached < total:
        gaps.append((reached, total))
    if len(gaps) > 1 and gaps[0][0] == 0 and gaps[-1][1] == total:
        (_, end), (start, _) = gaps.pop(0), gaps.pop()
        gaps.append((start, total + end))
    return gaps


def _opening(gap: tuple[float, float], edges: SurfaceArrays, begins: FloatArray) -> Opening | None:
    """Return the opening that a gap, given by its positions along the ring, is, if any."""
    start, end = gap
    begin = np.concatenate([begins, begins + edges.lengths.sum()])  # a gap may pass the first point
    length = np.tile(edges.lengths, 2)
    along = np.stack([np.maximum(start, begin), np.minimum(end, begin + length)], axis=1)
    along -= begin[:, None]
    pieces = np.flatnonzero(along[:, 1] - along[:, 0] >= SHORTEST_M)
    if not len(pieces):
        return None
    share = along[pieces] / length[pieces, None]
    first, second = edges.segments[pieces % len(edges)].swapaxes(0, 1)[:, :, None]
    segments = first + share[:, :, None] * (second - first)
    width = np.linalg.norm(segments[-1, 1] - segments[0, 0])
    longest = (along[pieces, 1] - along[pieces, 0]).max()
    if max(width, longest) > DOOR_M:
        return Opening("open side", segments)
    within = (start > begin + TOUCH_M) & (end < begin + length - TOUCH_M)
    return Opening("door" if within.any() else "corner", segments)
