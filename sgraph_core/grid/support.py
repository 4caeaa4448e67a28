"""Collinear support: what tells walls from the furniture that stands at them."""

from __future__ import annotations

import numpy as np
import shapely

from sgraph_concepts.types import FloatArray, SurfaceArrays
from sgraph_core.geometry import dot, in_frames, lines_of, points_of

__all__ = ["collinear_support"]

REACH_M = 30.0
"""Surfaces on one line support one another up to this far beyond their ends."""
OFFSET_M = 0.05
"""How far a surface may be from the line that supports it."""
TURN_COSINE = np.cos(np.radians(10.0))
"""Short surfaces may be turned this far from the line that supports them."""


def collinear_support(surfaces: SurfaceArrays) -> FloatArray:
    """Return the length of all surfaces on each one's line that face its way, in metres, [N].

    A surface counts itself. Walls line up with other walls of the building, furniture seldom
    does. Of two surfaces the longer one is the line, since its direction is known better.
    """
    lengths = surfaces.lengths
    half = (lengths / 2 + REACH_M)[:, None] * surfaces.tangents
    lines = lines_of(np.stack([surfaces.midpoints - half, surfaces.midpoints + half], axis=1))
    long, short = shapely.STRtree(points_of(surfaces.midpoints)).query(
        lines, predicate="dwithin", distance=OFFSET_M
    )
    rank = np.argsort(np.argsort(lengths, kind="stable"))
    longer = rank[long] > rank[short]
    long, short = long[longer], short[longer]
    _, across = in_frames(surfaces, long, surfaces.segments[short])
    same_line = np.abs(across).max(axis=1) <= OFFSET_M
    same_line &= dot(surfaces.normals[long], surfaces.normals[short]) > TURN_COSINE
    long, short = long[same_line], short[same_line]
    count = len(surfaces)
    return np.asarray(
        lengths
        + np.bincount(short, lengths[long], count)
        + np.bincount(long, lengths[short], count)
    )
