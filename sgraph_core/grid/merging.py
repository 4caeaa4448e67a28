"""Collinear pieces of outlines become one surface where free space lies in front of the gap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.geometry import cross, dot, lines_of
from sgraph_core.grid.outlines import Mask
from sgraph_core.grid.pieces import Pieces, directions

__all__ = ["merged"]

LARGEST_TURN_COSINE = np.cos(np.radians(25.0))
"""Short pieces may be this far off the line that they are part of."""
CHUNK = 512
"""How many gaps are sampled at a time."""


@dataclass
class _Group:
    """Pieces found to be one so far: their ends, and their moments added up."""

    ends: FloatArray  # [K, 2, 2]
    weight: float
    mean: FloatArray  # [2]
    scatter: FloatArray  # [2, 2]

    def joined(self, other: _Group) -> _Group:
        weight = self.weight + other.weight
        apart = other.mean - self.mean
        outer = np.outer(apart, apart) * (self.weight * other.weight / weight)
        return _Group(
            np.concatenate([self.ends, other.ends]),
            weight,
            self.mean + apart * (other.weight / weight),
            self.scatter + other.scatter + outer,
        )

    def line(self) -> tuple[FloatArray, float]:
        """Return both ends of the fitted line and how far its pieces stray from it."""
        # the sum of the pieces' vectors tells which way the line runs
        chord = np.stack([np.zeros(2), (self.ends[:, 1] - self.ends[:, 0]).sum(axis=0)])
        along = directions(chord[None], self.scatter[None])[0]
        from_mean = self.ends.reshape(-1, 2) - self.mean
        reach = from_mean @ along
        line = self.mean + np.outer([reach.min(), reach.max()], along)
        return line, float(np.abs(cross(along, from_mean)).max())


def merged(
    pieces: Pieces, free: Mask, tolerance: float, widest_gap: float, front: float
) -> FloatArray:
    """Return the lines that are left once collinear pieces are merged, [M, 2, 2].

    The closest are merged first, as long as no piece of a line strays from it by more than the
    tolerance.

    Args:
        pieces: straight pieces of outlines.
        free: the free cells.
        tolerance: how far a piece may be from the line that it becomes a part of, in cells.
        widest_gap: widest gap along the line, in cells.
        front: how far in front of a gap it must be free, in cells.
    """
    groups = [
        _Group(pieces.ends[n : n + 1], pieces.weights[n], pieces.means[n], pieces.scatters[n])
        for n in range(len(pieces.ends))
    ]
    group_of = list(range(len(groups)))

    def find(piece: int) -> int:
        while group_of[piece] != piece:
            group_of[piece] = group_of[group_of[piece]]
            piece = group_of[piece]
        return piece

    for one, two in _candidates(pieces, free, tolerance, widest_gap, front).tolist():
        first, second = sorted((find(one), find(two)))
        if first == second:
            continue
        both = groups[first].joined(groups[second])
        if both.line()[1] <= tolerance:
            groups[first] = both
            group_of[second] = first
    lines = [groups[n].line()[0] for n in range(len(groups)) if group_of[n] == n]
    return np.array(lines).reshape(-1, 2, 2)


def _candidates(
    pieces: Pieces, free: Mask, tolerance: float, widest_gap: float, front: float
) -> IntArray:
    """Return pairs of pieces of which the second goes on where the first ends, closest first."""
    lines = lines_of(pieces.ends)
    one, two = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=widest_gap)
    along = directions(pieces.ends, pieces.scatters)
    ends, starts = pieces.ends[one, 1], pieces.ends[two, 0]
    between = along[one] + along[two]
    norm = np.hypot(between[:, 0], between[:, 1])
    straight = (one != two) & (dot(along[one], along[two]) > LARGEST_TURN_COSINE)
    between /= np.where(straight, norm, 1.0)[:, None]
    gap, offset = dot(starts - ends, between), cross(between, starts - ends)
    near = straight & (gap >= -2 * tolerance) & (gap <= widest_gap)
    near &= np.abs(offset) <= 2 * tolerance
    one, two, gap = one[near], two[near], gap[near]
    open_ = _free_in_front(free, ends[near], starts[near], between[near], front)
    one, two, gap = one[open_], two[open_], gap[open_]
    return np.stack([one, two], axis=1)[np.argsort(np.abs(gap), kind="stable")]


def _free_in_front(
    free: Mask, ends: FloatArray, starts: FloatArray, along: FloatArray, front: float
) -> np.ndarray:
    """Return before which gaps all is free, sampled every half cell, [P].

    The first cell in front does not count: outlines are good to a cell.
    """
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    height, width = free.shape
    result = np.empty(len(ends), bool)
    depths = np.arange(1.5, max(front, 1.5) + 0.5, 0.5)
    for low in range(0, len(ends), CHUNK):
        part = slice(low, low + CHUNK)
        gaps = starts[part] - ends[part]
        widest = np.hypot(gaps[:, 0], gaps[:, 1]).max()
        shares = np.linspace(0, 1, 2 + int(2 * widest))
        places = ends[part, None] + shares[:, None] * gaps[:, None]
        places = places[:, :, None] + depths[:, None] * normals[part, None, None]
        column = np.clip(places[..., 0].astype(np.int64), 0, width - 1)
        row = np.clip(places[..., 1].astype(np.int64), 0, height - 1)
        result[part] = free[row, column].all(axis=(1, 2))
    return result
