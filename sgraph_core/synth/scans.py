"""What a robot's scans leave on a grid: free cells where rays pass, occupied ones where they end.

Rays are cast exactly, at segments; the cells are counted. Coordinates are (column, row), in cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray, OccupancyGrid
from sgraph_core.geometry import cross, lines_of, points_of
from sgraph_core.synth.raster import flat_cells, spread

__all__ = ["Obstacles", "Scanner", "scan"]

RAYS_AT_ONCE = 20_000
"""Bounds the memory."""
NOTHING = -1


@dataclass(frozen=True, eq=False)
class Obstacles:
    """O segments that may stop rays.

    Attributes:
        segments: [O, 2, 2].
        stopping: the share of the rays that each stops, [O].
        dark: whether rays that it stops come back, [O]; those that do not tell nothing.
    """

    segments: FloatArray
    stopping: FloatArray
    dark: NDArray[np.bool_]


@dataclass(frozen=True)
class Scanner:
    """A range finder and how well its scans are put into the map. Lengths are in cells.

    Attributes:
        beams: of a full turn.
        reach: how far it sees.
        range_noise: standard deviation of the ranges.
        pose_noise, angle_noise: standard deviations of a scan's place, and of its direction in rad.
        clearing: whether rays that meet nothing free the cells they pass.
        occupied_from: share of the rays through or into a cell that end there, from which on it is
            occupied.
    """

    beams: int
    reach: float
    range_noise: float
    pose_noise: float
    angle_noise: float
    clearing: bool
    occupied_from: float


def scan(
    poses: FloatArray,
    obstacles: Obstacles,
    scanner: Scanner,
    shape: tuple[int, int],
    rng: Generator,
) -> NDArray[np.uint8]:
    """Return the cells that scans from given positions [K, 2] leave, [H, W]."""
    hits, passes = np.zeros(shape[0] * shape[1], np.int64), np.zeros(shape[0] * shape[1], np.int64)
    at_once = max(1, RAYS_AT_ONCE // scanner.beams)
    for some in np.split(poses, np.arange(at_once, len(poses), at_once)):
        turns = rng.uniform(0, 2 * np.pi, len(some))
        ranges, ends = _cast(some, turns, obstacles, scanner, rng)
        told = ranges.ravel() + rng.normal(0, scanner.range_noise, ranges.size)
        returned = np.isfinite(told) & (told > 0)
        told = np.where(returned, np.maximum(told, 0), scanner.reach)
        seen = returned | (scanner.clearing & (ends.ravel() == NOTHING))
        placed = some + rng.normal(0, scanner.pose_noise, some.shape)
        turned = turns + rng.normal(0, scanner.angle_noise, len(some))
        starts = np.repeat(placed, scanner.beams, axis=0)
        rays = _directions(turned, scanner.beams).reshape(-1, 2)
        _count(starts[seen], rays[seen], told[seen], returned[seen], hits, passes, shape)
    occupied = (hits > 0) & (hits >= scanner.occupied_from * (hits + passes))
    cells = np.full(len(hits), OccupancyGrid.UNKNOWN, np.uint8)
    cells[passes > 0] = OccupancyGrid.FREE
    cells[occupied] = OccupancyGrid.OCCUPIED
    return cells.reshape(shape)


def _directions(turns: FloatArray, beams: int) -> FloatArray:
    """Return unit vectors along the beams of scanners turned by given angles, [K, B, 2]."""
    angles = turns[:, None] + 2 * np.pi * np.arange(beams) / beams
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _cast(
    poses: FloatArray, turns: FloatArray, obstacles: Obstacles, scanner: Scanner, rng: Generator
) -> tuple[FloatArray, IntArray]:
    """Return the lengths of the rays and the obstacle at which each ends, [K, B] each.

    A ray that meets nothing within reach, or an obstacle that is dark, is infinitely long.
    """
    beams, pitch = scanner.beams, 2 * np.pi / scanner.beams
    tree = shapely.STRtree(lines_of(obstacles.segments))
    pose, row = tree.query(points_of(poses), predicate="dwithin", distance=scanner.reach)
    first, second = (obstacles.segments[row, end] - poses[pose] for end in (0, 1))
    swapped = cross(first, second) < 0
    right, left = np.where(swapped[:, None], [second, first], [first, second])
    # the beams from the right end of each obstacle to the left one
    low = np.arctan2(right[:, 1], right[:, 0]) - turns[pose]
    width = np.mod(np.arctan2(left[:, 1], left[:, 0]) - turns[pose] - low, 2 * np.pi)
    begin = np.ceil(low / pitch)
    count = np.maximum(np.floor((low + width) / pitch) - begin + 1, 0).astype(np.int64)
    view, beam = spread(begin.astype(np.int64), count)
    kept = rng.random(len(view)) < obstacles.stopping[row[view]]
    view, beam = view[kept], beam[kept] % beams

    directions = _directions(turns, beams)
    along = (left - right)[view]
    slant = cross(directions[pose[view], beam], along)
    lengths = np.full(len(view), np.inf)
    np.divide(cross(right[view], along), slant, out=lengths, where=slant != 0)
    lengths[(lengths < 0) | (lengths > scanner.reach)] = np.inf
    ray = pose[view] * beams + beam
    nearest = np.full(len(poses) * beams, np.inf)
    np.minimum.at(nearest, ray, lengths)
    ends = np.full(len(nearest), NOTHING)
    met = np.isfinite(lengths) & (lengths == nearest[ray])
    ends[ray[met]] = row[view[met]]
    nearest[(ends != NOTHING) & obstacles.dark[ends]] = np.inf
    return nearest.reshape(len(poses), beams), ends.reshape(len(poses), beams)


def _count(
    starts: FloatArray,
    rays: FloatArray,
    lengths: FloatArray,
    returned: NDArray[np.bool_],
    hits: IntArray,
    passes: IntArray,
    shape: tuple[int, int],
) -> None:
    """Add up the rays that pass each cell and those that end in it."""
    inside, end_cells = flat_cells((starts + lengths[:, None] * rays)[returned], shape)
    hits += np.bincount(end_cells, minlength=len(hits))
    last = np.full(len(starts), NOTHING)
    last[np.flatnonzero(returned)[inside]] = end_cells
    steps = np.floor(np.minimum(lengths, _to_border(starts, rays, shape))).astype(np.int64)
    order = np.argsort(-steps, kind="stable")
    (x, y), (along_x, along_y) = (starts + 0.5 * rays)[order].T.copy(), rays[order].T.copy()
    last, steps = last[order], steps[order]
    cells = np.empty(steps.sum(), np.int64)
    done = 0
    for step in range(steps.max(initial=0)):  # all rays go on by one cell at a time
        count = len(steps) - int(np.searchsorted(steps[::-1], step, side="right"))
        cell = y[:count].astype(np.int64) * shape[1] + x[:count].astype(np.int64)
        cells[done : done + count] = np.where(cell == last[:count], len(passes), cell)
        x[:count] += along_x[:count]
        y[:count] += along_y[:count]
        done += count
    passes += np.bincount(cells, minlength=len(passes) + 1)[:-1]


def _to_border(starts: FloatArray, rays: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """Return how far rays go from where they start to the border of the grid."""
    border = np.where(rays > 0, np.array(shape[::-1]) - 1e-6, 0.0)
    with np.errstate(divide="ignore"):
        away = np.where(rays != 0, (border - starts) / rays, np.inf)
    return np.asarray(np.maximum(away.min(axis=1), 0))
