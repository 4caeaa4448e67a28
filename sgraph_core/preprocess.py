"""Step c) of the paper: surfaces become 2-D lines without duplicates, split where they intersect.

A long surface may bound several rooms; where another surface meets it, it is split, so that each
fragment can belong to a room of its own. Every fragment carries the id of its parent.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.geometry import close_together, in_frames

__all__ = [
    "DUPLICATE_ANGLE_RAD",
    "DUPLICATE_OFFSET_M",
    "TOUCH_M",
    "Fragments",
    "drop_duplicates",
    "flatten",
    "preprocess",
    "split",
]

DUPLICATE_OFFSET_M = 0.05
"""Two observations of one surface lie this close; the sides of the thinnest walls (6 cm) do not,
and face opposite ways besides."""
DUPLICATE_ANGLE_RAD = np.radians(5.0)
DUPLICATE_OVERLAP = 0.8
"""Share of the shorter surface that must lie along the longer one."""

TOUCH_M = 0.1
"""How far the end of a surface may stay away from the surface that it meets."""
SPLIT_ANGLE_RAD = np.radians(20.0)
"""Surfaces at a smaller angle run alongside each other rather than meet."""
SPLIT_DEPTH_M = 0.3
"""A surface splits another only if it reaches this far into the space in front of it: pilasters and
door frames do not divide a room."""
SHORTEST_FRAGMENT_M = 0.5
"""A cut closer than this to an end is that end's corner; between two cuts this close, the end of
the wall that cuts hides the surface, and the piece is dropped."""


@dataclass(frozen=True, eq=False)
class Fragments:
    """What preprocessing leaves.

    Attributes:
        surfaces: the fragments; ``ids`` are those of their parents, [N].
        duplicates: id of the surface that stands for each dropped one.
    """

    surfaces: SurfaceArrays
    duplicates: Mapping[int, int] = field(default_factory=dict)

    def parents(self, rows: IntArray) -> frozenset[int]:
        """Return the ids of the input's surfaces that fragments belong to."""
        return frozenset(self.surfaces.ids[rows].tolist())

    def with_duplicates(self, members: frozenset[int]) -> frozenset[int]:
        """Return surfaces together with those that repeat one of them."""
        return members.union(c for c, original in self.duplicates.items() if original in members)

    def alternatives(self, members: frozenset[int]) -> list[frozenset[int]]:
        """Return surfaces as they are, and with each repeated one exchanged for its copy."""
        copies = [(c, original) for c, original in self.duplicates.items() if original in members]
        return [members, *(members - {original} | {c} for c, original in copies)]


def flatten(points: ArrayLike, viewpoint: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the segment and the normal of a vertical surface given by its points.

    The line is the total least-squares fit of the points' x and y; its ends are the outermost
    points along it.

    Args:
        points: points on one side of a wall, [P, 2] or [P, 3], in the world.
        viewpoint: where they were seen from, [2] or [3]; the normal points to its side.

    Returns:
        Endpoints [2, 2] and unit normal [2].

    Raises:
        InputError: fewer than two points, points that are not finite, or points on one vertical.
    """
    plan = np.asarray(points, np.float64)
    if plan.ndim != 2 or plan.shape[0] < 2 or plan.shape[1] not in (2, 3):
        raise InputError(f"points have shape {list(plan.shape)}: must be [P, 2] or [P, 3], P >= 2")
    if not np.isfinite(plan).all():
        raise InputError("points must be finite")
    plan = plan[:, :2]
    centre = plan.mean(axis=0)
    _, spread, directions = np.linalg.svd(plan - centre, full_matrices=False)
    if spread[0] < 1e-9:
        raise InputError("points lie on one vertical line: they have no direction in the plan")
    along = directions[0]
    reach = (plan - centre) @ along
    normal = np.array([-along[1], along[0]])
    if normal @ (np.asarray(viewpoint, np.float64)[:2] - centre) < 0:
        normal = -normal
    return centre + np.outer([reach.min(), reach.max()], along), normal


def preprocess(
    surfaces: SurfaceArrays, may_stand: Callable[[int, int], bool] = lambda _original, _copy: True
) -> Fragments:
    """Drop duplicates and split surfaces where others meet them.

    Args:
        surfaces: the wall surfaces.
        may_stand: asked with the ids of an original and its copy before the copy is dropped.
    """
    if len(surfaces) < 2:
        return Fragments(surfaces)
    kept, duplicates = drop_duplicates(surfaces, may_stand)
    return Fragments(split(kept), duplicates)


def _near(surfaces: SurfaceArrays, distance_m: float) -> tuple[IntArray, IntArray]:
    """Return all ordered pairs of different surfaces that come this close."""
    one, two = close_together(surfaces.segments, surfaces.segments, distance_m)
    apart = one != two
    return one[apart], two[apart]


def drop_duplicates(
    surfaces: SurfaceArrays, may_stand: Callable[[int, int], bool] = lambda _original, _copy: True
) -> tuple[SurfaceArrays, dict[int, int]]:
    """Return the surfaces that repeat no other one, and who stands for each that does, by id."""
    long, short = _near(surfaces, DUPLICATE_OFFSET_M)
    lengths, ids = surfaces.lengths, surfaces.ids
    longer = (lengths[long] > lengths[short]) | (
        (lengths[long] == lengths[short]) & (ids[long] < ids[short])
    )
    same_way = (surfaces.normals[long] * surfaces.normals[short]).sum(axis=1) > np.cos(
        DUPLICATE_ANGLE_RAD
    )
    long, short = long[longer & same_way], short[longer & same_way]
    along, across = in_frames(surfaces, long, surfaces.segments[short])
    half = lengths[long] / 2
    overlap = np.minimum(along.max(axis=1), half) - np.maximum(along.min(axis=1), -half)
    repeats = (np.abs(across).max(axis=1) <= DUPLICATE_OFFSET_M) & (
        overlap >= DUPLICATE_OVERLAP * lengths[short]
    )
    long, short = long[repeats], short[repeats]

    # the longest surface decides first; what it drops can stand for nobody
    stands_for: dict[int, int] = {}
    for k in np.lexsort((ids[short], ids[long], -lengths[long])):
        original, copy = int(long[k]), int(short[k])
        if original in stands_for or copy in stands_for:
            continue
        if may_stand(int(ids[original]), int(ids[copy])):
            stands_for[copy] = original
    keep = np.ones(len(surfaces), bool)
    keep[list(stands_for)] = False
    return surfaces.take(keep), {int(ids[s]): int(ids[r]) for s, r in stands_for.items()}


def split(surfaces: SurfaceArrays) -> SurfaceArrays:
    """Return the fragments of surfaces that do not repeat one another."""
    cut, knife = _near(surfaces, TOUCH_M)
    sine = np.abs((surfaces.tangents[cut] * surfaces.normals[knife]).sum(axis=1))
    meets = sine > np.sin(SPLIT_ANGLE_RAD)
    cut, knife = cut[meets], knife[meets]
    along, across = in_frames(surfaces, cut, surfaces.segments[knife])
    # where the knife's line crosses the cut surface's line; the angle keeps this well defined
    share = across[:, 0] / (across[:, 0] - across[:, 1])
    position = along[:, 0] + share * (along[:, 1] - along[:, 0])
    inside = np.abs(position) < surfaces.lengths[cut] / 2 - SHORTEST_FRAGMENT_M
    divides = inside & (across.max(axis=1) > SPLIT_DEPTH_M)
    cut, position = cut[divides], position[divides]

    pieces = [surfaces.take(np.isin(np.arange(len(surfaces)), cut, invert=True))]
    for row in np.unique(cut).tolist():
        half = surfaces.lengths[row] / 2
        borders = np.array([-half, *np.sort(position[cut == row]), half])
        long_enough = np.diff(borders) >= SHORTEST_FRAGMENT_M
        reach = np.stack([borders[:-1], borders[1:]], axis=1)[long_enough]
        segments = surfaces.midpoints[row] + reach[:, :, None] * surfaces.tangents[row]
        parent = np.full(len(reach), row)
        pieces.append(SurfaceArrays(surfaces.ids[parent], segments, surfaces.normals[parent]))
    return SurfaceArrays(
        np.concatenate([piece.ids for piece in pieces]),
        np.concatenate([piece.segments for piece in pieces]),
        np.concatenate([piece.normals for piece in pieces]),
    )
